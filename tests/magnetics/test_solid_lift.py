"""Tables whose end effects a few solutions set: known factors come back, reciprocity is kept, kept points are taken."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.field.end_effects import EndFactors
from msl_fem.magnetics.sweep import solid_lift
from msl_fem.magnetics.sweep.solid_lift import SectionPoints, SolidRow, lift_points, lifted_sweep
from msl_fem.magnetics.sweep.table_sweep import SweepSettings
from msl_fem.magnetics.three_d.magnet_point import SolidPoint

GEOMETRIES = Path(__file__).parents[2] / "geometries"
TRUTH = EndFactors(gap=1.3, window=1.15, outer=0.35, leakage=0.4e-3)
GRID = [0.4e-3, 0.55e-3, 0.8e-3], [1.0, 2.0, 4.0, 6.0]


def point_of_known_factors(actuator: Actuator, current: float, gap: float, *, accuracy: Any) -> tuple[SolidPoint, ...]:
    """A corrected section in place of three dimensions, so that the right factors are known."""
    ((force, flux),) = SectionPoints(actuator, [SolidRow(gap, current)], accuracy)(TRUTH)
    return (SolidPoint(current, gap, force, force, flux, np.nan, np.nan, np.nan, 1e-3, 2e-3, 100, 1), None, None)


def test_a_lifted_sweep_finds_the_factors_states_its_errors_and_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(solid_lift, "N_GAPS", 2)
    monkeypatch.setattr(solid_lift, "SHARES", (0.3, 1.0))
    monkeypatch.setattr(solid_lift, "solve_solid", point_of_known_factors)
    e1 = load_actuator(GEOMETRIES / "e1.toml")
    settings = SweepSettings("fast", cache=tmp_path, resume=True)
    table, report, lift = lifted_sweep(e1, *GRID, settings=settings)
    assert lift.solutions == 5
    assert report.mesh_error == table.mesh_error
    assert lift.fit_error < 1e-3
    assert lift.check_error < 0.015, "the interpolation of four currents across the knee"
    assert lift.factors.leakage == pytest.approx(TRUTH.leakage, rel=0.1)
    assert lift.factors.window == pytest.approx(TRUTH.window, rel=0.05)
    assert table.mesh_error == pytest.approx(max(2e-3, lift.check_error, lift.fit_error), rel=0.5)
    assert table.provenance["end_effects"].startswith("three dimensions: 5 solutions")
    assert table.provenance["end_factors"]["leakage"] == lift.factors.leakage
    points = table.provenance["lift_points"]
    assert [p["current"] for p in points] == pytest.approx([1.8, 6.0, 1.8, 6.0, 3.9])
    assert [p["gap"] for p in points[:4]] == pytest.approx([4e-4, 4e-4, 8e-4, 8e-4])
    assert points[3]["force"] == pytest.approx(float(table.force(6.0, 8e-4)), rel=3e-3)
    ((force, flux),) = SectionPoints(e1, [SolidRow(0.55e-3, 4.0)], "fast")(TRUTH)
    assert table.force(4.0, 0.55e-3) == pytest.approx(force, rel=4e-3)
    assert table.flux_linkage(4.0, 0.55e-3) == pytest.approx(flux, rel=4e-3)
    step_i, step_g = 1e-4, 1e-8
    by_gap = (table.flux_linkage(3.1, 5e-4 + step_g) - table.flux_linkage(3.1, 5e-4 - step_g)) / (2 * step_g)
    by_current = (table.force(3.1 + step_i, 5e-4) - table.force(3.1 - step_i, 5e-4)) / (2 * step_i)
    assert by_current == pytest.approx(-by_gap, rel=1e-5)
    monkeypatch.setattr(solid_lift, "solve_solid", lambda *_, **__: pytest.fail("a kept point is solved again"))
    monkeypatch.setattr(solid_lift, "fit_factors", lambda *_: lift.factors)
    again, _, _ = lifted_sweep(e1, *GRID, settings=settings)
    assert again.nodes["force"] == pytest.approx(table.nodes["force"])


def test_points_span_the_table_and_checks_lie_between_them() -> None:
    fitted, checks = lift_points([0.1e-3, 0.4e-3, 0.9e-3], [0.0, 3.0, 10.0])
    assert sorted({row.gap for row in fitted}) == pytest.approx([0.1e-3, 0.3e-3, 0.9e-3])
    assert max(row.current for row in fitted) == 10.0
    assert len(checks) == 3
    assert not {(row.gap, row.current) for row in checks} & {(row.gap, row.current) for row in fitted}


def test_a_magnet_without_a_stack_is_refused_before_any_work() -> None:
    pot_core = load_actuator(GEOMETRIES / "pot_core_holding.toml")
    with pytest.raises(InputError, match="no stack whose ends"):
        lifted_sweep(pot_core, [0.3e-3, 0.5e-3], [0.5, 1.0], settings=SweepSettings("fast"))
