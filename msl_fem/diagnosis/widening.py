"""The next experiment where no effect has a name: an excitation that moves what the rest depends on farther."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from msl_fem.diagnosis.next_experiment import Question, at_planned_length, menu, spec_of
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant import Simulation, bearable_run
from msl_fem.plant.excitation_kinds import Excitation

Array = NDArray[np.float64]
WIDER = 1.1  # times the spread of the run as it was, that is worth a run
_OF_CURRENT = ("current", "flux", "voltage", "command")


def wider(question: Question, variables: Sequence[str]) -> str:
    """What to do next, in words and as an excitation.

    Parameters
    ----------
    variables : that the rest was found to depend on; none: amplitudes are compared instead
    """
    name = variables[0] if variables else ""
    runs = _runs(question)
    if not runs:
        return ""
    base = spread(runs[0][2], name)
    if not name or not base:
        return _smaller(runs)
    words, excitation, simulation = max(runs, key=lambda run: spread(run[2], name))
    factor = spread(simulation, name) / base
    if factor < WIDER:
        return f"nothing on the menu moves {name} farther than this record did; a longer record narrows the curve"
    return f'{words}, simulate --excitation "{spec_of(excitation)}": {name} moves {factor:.2g} times as far'


def spread(run: Simulation, variable: str) -> float:
    """RMS deviation of what a variable is about: a current, a velocity, or else the position."""
    if variable.startswith(_OF_CURRENT) and run.current.size:
        return float(run.current.std(axis=0).max())
    values = run.velocity if "velocity" in variable else run.position
    return 0.0 if variable.startswith("time") else float(values.std())


def _runs(question: Question) -> list[tuple[str, Excitation, Simulation]]:
    """The entries of the menu in motion that the rig bears, the run as it was first."""
    belief, found = question.belief, []
    for entry in menu(question):
        if entry.locked:
            continue
        try:
            run, borne = bearable_run(belief.actuator, belief.table, entry.excitation, rate=question.run.rate)
        except (InputError, ComputationError):
            continue
        found.append((entry.words, at_planned_length(borne), run))
    return found


def _smaller(runs: Sequence[tuple[str, Excitation, Simulation]]) -> str:
    half = next((excitation for words, excitation, _ in runs if words == "half the amplitude"), None)
    if half is None:
        return ""
    return (
        f'half the amplitude, simulate --excitation "{spec_of(half)}": a rest that halves is linear in the motion, one '
        "that falls faster is not, one that stays is a disturbance from elsewhere"
    )
