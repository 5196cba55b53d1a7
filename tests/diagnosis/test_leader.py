"""The candidate in front is led to its end: once more from the belief, and in legs while they bring something."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from msl_fem.diagnosis.fit_memory import FitMemory
from msl_fem.diagnosis.likelihood import Columns, Fit
from msl_fem.diagnosis.refits import MORE_LEGS, Refinement, Refit, _may_lead
from msl_fem.diagnosis.unknowns import EffectUnknown, Unknowns
from msl_fem.diagnosis.variants import Variant

FRICTION = Variant("coulomb_friction", (EffectUnknown("coulomb_friction", "force"),))
UNKNOWNS = Unknowns((("moving_mass", 0.01), ("damping", 0.2)), 0, ())
BASE = Fit(
    UNKNOWNS,
    np.zeros(2),
    np.zeros(1),
    Columns(np.zeros((1, 2)), np.zeros((2, 2))),
    None,
    0.0,
    0.0,
    0.0,
    1,
    SimpleNamespace(is_cut=False),
)


def refit(z: list[float], gain: float) -> Refit:
    """A candidate at numbers of mass, damping and friction."""
    likelihood = SimpleNamespace(is_cut=False)
    unknowns = replace(UNKNOWNS, effects=FRICTION.unknowns)
    numbers = (np.array(z), np.zeros(1), Columns(np.zeros((1, 3)), np.zeros((3, 3))), None, -gain, gain, 0.0, 1)
    return Refit(FRICTION, Fit(unknowns, *numbers, likelihood), gain)


@pytest.fixture
def fits(monkeypatch) -> list[np.ndarray]:
    """Where fits began: one from a strained mass gains a hundred nats, one from the belief comes to 5000 at once."""
    begun: list[np.ndarray] = []

    def fitted(self: Refinement, near: Fit, variant: Variant, z: np.ndarray, *rest: object) -> Refit:
        begun.append(z)
        if abs(z[0]) > 1:
            return refit(list(z), -near.objective + 100.0)
        return refit([0.1, 0.1, z[2]], 5000.0)

    monkeypatch.setattr(Refinement, "_refit", fitted)
    return begun


def led(z: list[float], *, leads: bool) -> Refit:
    return Refinement(BASE, lambda text: None, FitMemory()).converged(refit(z, 1000.0), leads=leads)


def test_a_strained_leader_begins_once_more_where_all_else_is_as_believed(fits) -> None:
    found = led([9.0, 5.0, 0.3], leads=True)
    assert found.gain == 5000.0
    assert found.fit.finished
    assert fits[0].tolist() == [0.0, 0.0, 0.3]


def test_a_leader_goes_on_while_it_gains_and_others_take_one_leg(fits) -> None:
    led([3.0, 2.0, 0.3], leads=True)
    assert len(fits) == 1 + MORE_LEGS
    fits.clear()
    assert led([9.0, 5.0, 0.3], leads=False).gain == 1100.0
    assert len(fits) == 1


def test_the_better_of_both_is_kept(fits, monkeypatch) -> None:
    monkeypatch.setattr("msl_fem.diagnosis.refits.MORE_LEGS", 0)
    begin = refit([9.0, 5.0, 0.3], 6000.0)
    assert Refinement(BASE, lambda text: None, FitMemory()).converged(begin, leads=True).gain == 6100.0


@pytest.mark.parametrize("lost", [True, False])
def test_beside_a_lost_model_the_leader_s_other_forms_are_led_to_their_ends_too(lost: bool) -> None:
    near = SimpleNamespace(jacobian=np.zeros((1, 1)), sane=None, unknowns=SimpleNamespace(n_nuisance=1))
    base: Any = SimpleNamespace(sane=near, unknowns=near.unknowns) if lost else near
    force, slip, mode = (
        SimpleNamespace(gain=gain, variant=SimpleNamespace(effect=effect))
        for gain, effect in ((3.0, "coulomb_friction"), (2.0, "coulomb_friction"), (2.5, "structural_mode"))
    )
    refinement = Refinement(base, lambda text: None, FitMemory())
    assert refinement._other_forms(force, [mode, slip]) == ([slip] if lost else [])  # type: ignore[arg-type, list-item]


def test_a_candidate_whose_next_step_promises_the_lead_goes_on() -> None:
    """Remanence beside early saturation: 849 nats, 927 after a round that promises 413 more, the leader 1189."""
    before, after = refit([0.1, 0.1, 0.1], 848.9), refit([0.1, 0.1, 0.1], 926.8)
    promises = [replace(after, fit=replace(after.fit, predicted=nats)) for nats in (413.0, 100.0)]
    assert [_may_lead(before, one, 1189.1) for one in promises] == [True, False]
    idle = replace(promises[0], gain=before.gain + 1.0)
    assert not _may_lead(before, idle, 1189.1), "a promise alone is none"
