"""What a designed loop promises and what it did: one sheet of figures, on the belief and on plants it has not seen.

Margins are of the loop opened at the plant's input, at frozen positions (Franklin, Powell, Emami-Naeini, Feedback
Control, 7th ed., sec. 6.4). The delay margin is the least phase margin over its frequency: so much later the command
may come (Ogata, Modern Control Engineering, 5th ed., sec. 7.7). The dynamic stiffness is the force of a sine on the
mass over the position that it moves, |1/(P S)|, at its least.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.control.closed_loop import ClosedLoopRun
from msl_fem.control.design import ZONE_ENDS, ControllerDesign, FrozenPosition
from msl_fem.control.design_model import AtPosition
from msl_fem.control.improvement import Improvement
from msl_fem.control.inverse import force_limits, held_stiffness
from msl_fem.control.linear_loop import Complex, flat_band, grid
from msl_fem.control.margins import Margins, margins
from msl_fem.control.output_stage import BIAS
from msl_fem.control.unseen_plants import UnseenPlants
from msl_fem.errors import InputError
from msl_fem.files.numbers import json_value

_N_GRID = 1000
_HALVINGS = 12
WORKING_SHARE = 0.8
"""Of the reach: the positions over which margins and disturbance are the worst of."""


@dataclass(frozen=True, eq=False)
class SpecSheet:
    """The figures of a designed loop.

    Attributes
    ----------
    positions : (n,) frozen positions over the reach, with the loop's margins there
    margins : of the `positions`
    reference_peak, reference_peak_at : dB and Hz, the highest gain from reference to position, at or above 0 dB
    flat_band, wide_band : Hz up to which that gain stays within 1 dB and within 3 dB of 0 dB
    least_stiffness, least_stiffness_at : N/m and Hz, in the middle
    largest_disturbance : N, constant, either way, that guard, drive and loop (zone C or better) bear at the middle and
        the ends of the working positions
    run : of the reference on the plant, where there is one
    unseen : the same on plants that were not seen, where there are any
    over_belief : after a diagnosis, how much better it is foretold to track than the loop of the belief
    """

    design: ControllerDesign
    positions: tuple[FrozenPosition, ...]
    margins: tuple[Margins, ...]
    reference_peak: float
    reference_peak_at: float
    flat_band: float
    wide_band: float
    least_stiffness: float
    least_stiffness_at: float
    largest_disturbance: float
    run: ClosedLoopRun | None = None
    unseen: UnseenPlants | None = None
    over_belief: Improvement | None = None

    def working(self) -> list[tuple[FrozenPosition, Margins]]:
        """The positions within `WORKING_SHARE` of the reach."""
        low, high = (WORKING_SHARE * (1 + 1e-9) * end for end in self.design.reach)
        pairs = zip(self.positions, self.margins, strict=True)
        return [pair for pair in pairs if low <= pair[0].position <= high]

    def to_json(self) -> dict[str, Any]:
        """The JSON object `loop`."""
        working = self.working()
        worst = max(working, key=lambda pair: pair[0].peak_sensitivity)[0]
        of_worst = worst_of([m for _, m in working])
        fields: dict[str, Any] = {
            "peak_sensitivity": json_value(self.design.peak_sensitivity),
            "worst_peak_sensitivity": json_value(worst.peak_sensitivity),
            "worst_peak_sensitivity_at_m": worst.position,
            "working_positions_m": [WORKING_SHARE * end for end in self.design.reach],
            "gain_margin": [json_value(of_worst.gain_down), json_value(of_worst.gain_up)],
            "phase_margin_deg": json_value(of_worst.phase),
            "delay_margin_s": json_value(of_worst.delay),
            "reference_known_ahead": self.design.law.feedforward and self.design.law.preview,
            "reference_peak_dB": self.reference_peak,
            "reference_peak_Hz": self.reference_peak_at,
            "band_1dB_Hz": self.flat_band,
            "band_3dB_Hz": self.wide_band,
            "least_dynamic_stiffness_N_per_m": self.least_stiffness,
            "least_dynamic_stiffness_Hz": self.least_stiffness_at,
            "largest_disturbance_N": self.largest_disturbance,
            "positions": [_at(p, m) for p, m in zip(self.positions, self.margins, strict=True)],
        }
        if self.run is not None:
            fields |= {"copper_loss_W": self.run.copper_loss, "guard_share": self.run.guard_share}
        if self.unseen is not None:
            fields |= {"unseen": self.unseen.to_json()} | _headline(self.unseen)
        return fields if self.over_belief is None else fields | {"over_belief": self.over_belief.to_json()}


def _headline(unseen: UnseenPlants) -> dict[str, Any]:
    figures = unseen.to_json()
    return {name: figures[name] for name in ("held_share", "error_95", "guard_violations")}


def _at(position: FrozenPosition, margin: Margins) -> dict[str, Any]:
    return {
        "position_m": position.position,
        "peak_sensitivity": json_value(position.peak_sensitivity),
        "lower_bound": position.bound,
        "gain_margin": [json_value(margin.gain_down), json_value(margin.gain_up)],
        "phase_margin_deg": json_value(margin.phase),
        "delay_margin_s": json_value(margin.delay),
    }


def worst_of(several: Sequence[Margins]) -> Margins:
    """The least margin of each kind."""
    return Margins(
        min(m.gain_up for m in several),
        max(m.gain_down for m in several),
        float(np.nanmin([m.phase for m in several])),
        float(np.nanmin([m.delay for m in several])),
    )


def spec_sheet(
    design: ControllerDesign,
    *,
    run: ClosedLoopRun | None = None,
    unseen: UnseenPlants | None = None,
    over_belief: Improvement | None = None,
) -> SpecSheet:
    """The sheet of a design.

    Raises
    ------
    InputError : the loop is unstable in the middle
    """
    if not np.isfinite(design.peak_sensitivity):
        raise InputError(
            f"the {design.kind} design is unstable in the middle of its travel; wish for another bandwidth"
        )
    law = design.law
    f = grid(law.plant.period, _N_GRID)
    response = law.reference_response(f)
    gain = 20 * np.log10(np.abs(response))
    peak = int(np.argmax(gain))
    stiffness = _dynamic_stiffness(design, f)
    least = int(np.argmin(stiffness))
    return SpecSheet(
        design=design,
        positions=design.frozen,
        margins=tuple(_margins_at(design, p, f) for p in design.frozen),
        reference_peak=max(float(gain[peak]), 0.0),
        reference_peak_at=float(f[peak]),
        flat_band=flat_band(response, f),
        wide_band=flat_band(response, f, decibel=20 * np.log10(np.sqrt(2))),
        least_stiffness=float(stiffness[least]),
        least_stiffness_at=float(f[least]),
        largest_disturbance=_largest_disturbance(design),
        run=run,
        unseen=unseen,
        over_belief=over_belief,
    )


def _margins_at(design: ControllerDesign, position: FrozenPosition, frequency: Array) -> Margins:
    """The margins; none where the loop is unstable."""
    if not np.isfinite(position.peak_sensitivity):
        return Margins(1.0, 1.0, 0.0, 0.0)
    return margins(design.law_at(position.position).loop_transfer(frequency, position.at), frequency)


def _dynamic_stiffness(design: ControllerDesign, frequency: Array) -> Array:
    """(n_frequency,) N/m of a continuous force on the mass, around which the sampled loop is closed."""
    plant = design.law.plant
    jw = 2j * np.pi * frequency
    motion = 1 / (plant.mass * jw**2 + plant.damping * jw + plant.stiffness)
    loop: Complex = design.law.loop_transfer(frequency)
    return np.asarray(np.abs((1 + loop) / motion))


def _largest_disturbance(design: ControllerDesign) -> float:
    """N that is borne either way at the middle and at both ends of the working positions."""
    places = (WORKING_SHARE * design.reach[0], 0.0, WORKING_SHARE * design.reach[1])
    return max(0.0, min(_borne(design, x, toward) for x in places for toward in (-1.0, 1.0)))


def _borne(design: ControllerDesign, position: float, toward: float) -> float:
    """N along `toward` that guard and drive leave at a position, and that the loop bears in zone C or better.

    The pull that stands against it makes the magnets' negative stiffness larger, so the loop's limit comes first at
    small gaps.
    """
    p = design.parameters
    holding = float((design.suspension + p.cubic * position**2) * position - p.constant_force)
    lowest, highest = force_limits(p.inverse, np.array([position]))[:, 0]
    most = holding - lowest if toward > 0 else highest - holding
    if p.stage.kind == BIAS or not most > 0:
        return float(most)
    low, high = 0.0, float(most)
    for _ in range(_HALVINGS):
        push = 0.5 * (low + high)
        held = held_stiffness(p.inverse, holding - toward * push, position, overlap=p.stage.overlap)
        at = AtPosition(held - 3 * p.cubic * position**2)
        law = design.law_at(position, toward * push)
        if law.peak_sensitivity(at, frequency=grid(design.law.plant.period, 120)) <= ZONE_ENDS[-1]:
            low = push
        else:
            high = push
    return low
