"""Whether a record can decide anything: long enough, excited, its sensors free, with a run that no fit has seen."""

from collections.abc import Sequence

import numpy as np

from msl_fem.prediction import ModelHypothesis, RunData, open_loop_stable
from msl_fem.prediction.run_data import POSITION_COLUMN
from msl_fem.record import Record

SHORTEST = 0.5  # s of all fit runs together
FEWEST = 3000  # samples of them
RESPONSE = 20.0  # times the noise: what the position has to move for anything to be seen


def why_not(record: Record, data: Sequence[RunData]) -> str:
    """Why nothing can be decided; empty where it can be."""
    fitted = [run for run in data if run.role == "fit"]
    if not fitted:
        return "no dynamic run has the role fit"
    if not any(run.role == "held-out" for run in data):
        return "no run is held out, so no gain could be shown; give one run the role held-out"
    stuck = [text for text in record.warnings if "clipped" in text or "stuck" in text]
    if stuck:
        return f"a sensor is stuck or clipped: {stuck[0]}"
    samples, seconds = sum(len(r.commands) for r in fitted), sum(len(r.commands) / r.rate for r in fitted)
    if samples < FEWEST or seconds < SHORTEST:
        return f"the fit runs hold {samples} samples in {seconds:.3g} s; at least {FEWEST} in {SHORTEST:g} s are needed"
    if max(float(np.ptp(run.commands, axis=0).max()) for run in fitted) == 0:
        return "the commands of the fit runs never change; excite the plant"
    moved = max(float(run.measured[POSITION_COLUMN].std() / run.noise[POSITION_COLUMN].sigma) for run in fitted)
    if moved < RESPONSE:
        return f"the position moves by {moved:.3g} times its noise; at least {RESPONSE:g} times are needed, excite more"
    return ""


def unstable_run(belief: ModelHypothesis, data: Sequence[RunData]) -> str:
    """The first run of an open loop that is not stable, in which a free run says nothing; empty where none is."""
    return next((run.name for run in data if not open_loop_stable(belief, run)), "")
