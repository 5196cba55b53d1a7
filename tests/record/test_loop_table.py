"""Loops at one gap become a table, the mean curve, and a diagnosis that names hysteresis and nothing else."""

import numpy as np
import pytest

from msl_fem.actuator import parse_actuator
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.static_maps import static_plant
from msl_fem.errors import InputError
from msl_fem.plant import surface_of
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.static_map import static_map
from msl_fem.record import Noise, Record, StaticMap
from msl_fem.record.loop_table import is_at_one_gap, law_of_loops, table_of_loops

CURRENT = np.concatenate([a * np.sin(np.linspace(0, 4 * np.pi, 81)) for a in (0.4, 0.7, 1.0)])
SEQUENCE = np.repeat([1.0, 2.0, 3.0], 81)
RING = {"schema": 1, "name": "ring", "magnet": {"kind": "table", "table": "none.nc"},
        "sides": {"count": 1, "magnets_per_side": 1}}  # fmt: skip


def curve(current):
    return np.tanh(current / 0.35) + 0.1 * current


def static(shift=0.0, *, seed=1, gap=1e-3):
    """Loops whose branches are shifted by the coercive current, but near the tips: no law of the package."""
    rng = np.random.default_rng(seed)
    rising = np.gradient(CURRENT) >= 0
    tip = np.repeat([0.4, 0.7, 1.0], 81)
    room = np.clip((1 - np.abs(CURRENT) / tip) / 0.2, 0, 1)
    flux = curve(CURRENT - shift * np.where(rising, 1, -1) * room) + rng.normal(0, 2e-3, CURRENT.size)
    role = np.where(SEQUENCE == 2, "held-out", "fit")
    return StaticMap(np.full(CURRENT.size, gap), CURRENT, None, flux, role, sequence=SEQUENCE)


def test_the_table_is_the_reversible_curve() -> None:
    """That of the law; loops without memory are their own curve."""
    at = np.linspace(0.05, 0.95, 30)
    flat = table_of_loops(static(0.0)).evaluate(at, np.full(30, 1e-3))
    assert flat["flux_linkage"] == pytest.approx(curve(at), abs=0.01)
    rows = static(0.04)
    found = table_of_loops(rows).evaluate(at, np.full(30, 1e-3))
    assert law_of_loops(rows).reversible(found["flux_linkage"])[0] == pytest.approx(at, rel=2e-3)
    slope = np.gradient(found["coenergy"], at)
    assert slope[1:-1] == pytest.approx(found["flux_linkage"][1:-1], rel=5e-3)
    assert np.abs(found["force"]).max() < 1e-9


def test_the_coupled_model_follows_the_law() -> None:
    """The kernel's stops on the table, driven by the current, lead where the law asks for that current."""
    rows = static(0.04)
    law, table = law_of_loops(rows), table_of_loops(rows)
    inductance = float(table.evaluate(0.0, 1e-3)["incremental_inductance"])
    shapes = {"spacing": law.spacing, "fall": law.fall, "widening": law.widening}
    memory = {"coercive_current": law.coercive_current, "reversal_current": law.reversal_flux / inductance, **shapes}
    _, flux = static_map(
        surface_of(table), static_plant(parse_actuator(RING), table, rows.gap).parameters,
        EffectValues({"magnetic_hysteresis": memory}), gap=rows.gap, current=rows.current, sequence=SEQUENCE,
    )  # fmt: skip
    for n in (1.0, 2.0, 3.0):
        loop = n == SEQUENCE
        assert law.current(flux[loop]) == pytest.approx(rows.current[loop], abs=2e-3)
        assert law.reversible(flux[loop])[0] != pytest.approx(rows.current[loop], abs=2e-2)


def test_more_than_one_gap_is_refused() -> None:
    rows = static()
    two = StaticMap(np.linspace(1e-3, 2e-3, CURRENT.size), CURRENT, None, rows.flux_linkage, rows.role)
    assert not is_at_one_gap(two)
    with pytest.raises(InputError, match="more than one gap"):
        table_of_loops(two)


@pytest.mark.parametrize("shift", [0.0, 0.05])
def test_loops_are_diagnosed_for_hysteresis(shift) -> None:
    rows = static(shift, seed=7)
    record = Record("measured", parse_actuator(RING), noise=Noise(flux_linkage=2e-3), static=rows)
    found = diagnose(record, DiagnosisSettings(table=table_of_loops(rows)))
    named = {cause.effect for cause in found.causes} | ({found.main_cause.effect} if found.main_cause else set())
    assert named == ({"magnetic_hysteresis"} if shift else set())
    if not shift:
        assert found.verdict == "nothing-found"
