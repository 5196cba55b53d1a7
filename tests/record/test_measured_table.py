"""Measured tables: force and flux recovered from noisy rows, energy consistency, thin data, refusals."""

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, saturating_reluctance

from msl_fem.cli.app import app
from msl_fem.cli.output import run_guarded
from msl_fem.errors import ComputationError, InputError
from msl_fem.record import Noise, StaticMap
from msl_fem.record.measured_table import MeasuredReport, table_from_measurements
from msl_fem.table.coenergy_fit import FLOOR, ORDERS, Samples, SaturatingReluctance, fit_base, fit_coenergy
from msl_fem.table.magnetic_table import NODES, MagneticTable, read_table

Truth = Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]
NOISE = Noise(force="0.5 N", flux_linkage="50 uWb")
SIGMA = {"force": 0.5, "flux_linkage": 5e-5}
I_MAX, G_MIN, G_MAX = 12.0, 2e-4, 1e-3


def two_knees(current: np.ndarray, gap: np.ndarray) -> dict[str, np.ndarray]:
    """A magnet that saturates twice, outside the family of the fit's W0: 0.7 W'(i, g) + 0.1 W'(2.5 i, g)."""
    one, two, k = saturating_reluctance(current, gap), saturating_reluctance(2.5 * np.asarray(current), gap), 2.5
    powers = {"flux_linkage": k, "incremental_inductance": k**2, "force_current_slope": k}
    return {name: 0.7 * one[name] + 0.1 * powers.get(name, 1.0) * two[name] for name in one}


def measure(truth: Truth, current: np.ndarray, gap: np.ndarray, *, seed: int = 1, role: str = "fit") -> StaticMap:
    """Rows of a magnet with the noise of `NOISE`."""
    rng = np.random.default_rng(seed)
    value = truth(current, gap)
    noisy = {name: value[name] + sigma * rng.standard_normal(current.size) for name, sigma in SIGMA.items()}
    return StaticMap(gap=gap, current=current, role=np.full(current.size, role), **noisy)


def scattered(truth: Truth, rows: int = 300, *, seed: int = 1) -> StaticMap:
    """Rows at random points, some on the rectangle's corners, of both signs of the current."""
    rng = np.random.default_rng(seed)
    i, g = rng.uniform(0, I_MAX, rows), rng.uniform(G_MIN, G_MAX, rows)
    i[:4], g[:4] = [0.5, I_MAX, 0.5, I_MAX], [G_MIN, G_MIN, G_MAX, G_MAX]
    return measure(truth, i * rng.choice([-1, 1], rows), g, seed=seed)


def inner_points() -> tuple[np.ndarray, np.ndarray]:
    i, g = np.meshgrid(np.linspace(-11.5, 11.5, 40), np.linspace(2.3e-4, 9.7e-4, 25))
    return i.ravel(), g.ravel()


def deviation(table: MagneticTable, truth: Truth) -> dict[str, float]:
    """Largest deviation from the truth inside the rectangle, in sigmas of one measurement."""
    i, g = inner_points()
    got, there = table.evaluate(i, g), truth(i, g)
    return {name: float(np.abs(got[name] - there[name]).max()) / sigma for name, sigma in SIGMA.items()}


@pytest.fixture(scope="module")
def fitted() -> tuple[MagneticTable, MeasuredReport]:
    return table_from_measurements(scattered(saturating_reluctance), NOISE)


# --- what is recovered ------------------------------------------------------------------------------------------------


def test_force_and_flux_come_back_within_a_few_sigmas(fitted) -> None:
    table, report = fitted
    worst = deviation(table, saturating_reluctance)
    assert worst["force"] < 3
    assert worst["flux_linkage"] < 3
    assert report.points == 300
    assert report.force_residual == pytest.approx(1, abs=0.15)
    assert report.flux_linkage_residual == pytest.approx(1, abs=0.15)
    assert report.thin_cells == 0
    assert report.notes == ()
    assert report.force_error < 0.01


def test_magnet_outside_the_models_family_comes_back_too() -> None:
    """The splines carry what the four-parameter reluctance cannot."""
    static = scattered(two_knees, 500)
    table, report = table_from_measurements(static, NOISE)
    worst = deviation(table, two_knees)
    assert worst["force"] < 0.004 * np.abs(table.nodes["force"]).max() / SIGMA["force"]
    assert worst["flux_linkage"] < 10
    assert report.force_residual is not None
    assert report.force_residual < 1.2
    assert report.flux_linkage_residual is not None
    assert report.flux_linkage_residual < 1.2
    base = SaturatingReluctance(**table.provenance["reluctance"])
    alone = -base.derivatives(*map(np.asarray, inner_points()))[0, 1] - two_knees(*inner_points())["force"]
    assert np.abs(alone).max() / SIGMA["force"] > 5 * worst["force"], "W0 alone would not do"


def test_table_is_one_coenergy_surface(fitted) -> None:
    """Reciprocity and evenness: force and flux of the table are derivatives of one even W'."""
    table, report = fitted
    i, g = inner_points()
    step_i, step_g = 1e-3, 1e-7
    at = table.evaluate(i, g)
    flux = table.evaluate(i + step_i, g)["coenergy"] - table.evaluate(i - step_i, g)["coenergy"]
    force = table.evaluate(i, g - step_g)["coenergy"] - table.evaluate(i, g + step_g)["coenergy"]
    assert np.abs(flux / (2 * step_i) - at["flux_linkage"]).max() < 1e-5 * np.abs(at["flux_linkage"]).max()
    assert np.abs(force / (2 * step_g) - at["force"]).max() < 1e-5 * np.abs(at["force"]).max()
    mirrored = table.evaluate(-i, g)
    assert np.array_equal(mirrored["coenergy"], at["coenergy"])
    assert np.array_equal(mirrored["flux_linkage"], -at["flux_linkage"])
    for name in ("coenergy", "flux_linkage", "force"):
        assert not table.nodes[name][:, 0].any(), "nothing without current"
    assert at["incremental_inductance"].min() > 0
    assert report.reciprocity_error == table.reciprocity_error < 1e-3
    assert report.interpolation_error == table.interpolation_error < 1e-3


def test_nodes_are_derivatives_of_the_fit_itself() -> None:
    """All six quantities against differences of W' off the rectangle's symmetry, splines at work."""
    static = scattered(two_knees, 200)
    rows = static.current != 0
    samples = {
        name: Samples(
            np.abs(static.current[rows]), static.gap[rows],
            (np.sign(static.current[rows]) if name == "flux_linkage" else 1) * getattr(static, name)[rows],
            np.full(rows.sum(), sigma),
        )
        for name, sigma in SIGMA.items()
    }  # fmt: skip
    fit = fit_coenergy(samples, fit_base(samples), keep_positive=(np.array([1.0, 11.0]), np.array([3e-4, 9e-4])))
    i, g = np.array([0.7, 3.0, 8.0, 11.0]), np.array([2.5e-4, 4e-4, 7e-4, 9.5e-4])
    steps = {(1, 0): (1e-4, 0.0), (0, 1): (0.0, 1e-8)}
    for name, lower, direction in [
        ("flux_linkage", "coenergy", (1, 0)),
        ("force", "coenergy", (0, 1)),
        ("incremental_inductance", "flux_linkage", (1, 0)),
        ("force_current_slope", "force", (1, 0)),
        ("force_gap_slope", "force", (0, 1)),
    ]:
        di, dg = steps[direction]
        rise = (fit(lower, i + di, g + dg)[0] - fit(lower, i - di, g - dg)[0]) / (2 * (di + dg))
        sign = ORDERS[name][1] * ORDERS[lower][1]
        assert fit(name, i, g)[0] == pytest.approx(sign * rise, rel=1e-5), name


# --- one channel alone, other data ------------------------------------------------------------------------------------


def test_flux_alone_gives_force_by_virtual_work() -> None:
    static = dataclasses.replace(scattered(saturating_reluctance), force=None)
    table, report = table_from_measurements(static, NOISE)
    assert report.force_residual is None
    assert any("no force was measured" in note for note in report.notes)
    worst = deviation(table, saturating_reluctance)
    assert worst["force"] * SIGMA["force"] < 0.01 * np.abs(table.nodes["force"]).max()


def test_force_alone_leaves_out_flux_that_knows_no_gap() -> None:
    """A leakage inductance changes no force, so force cannot show it; the note says what is left out."""
    leakage = 5e-3
    static = scattered(saturating_reluctance)
    assert static.flux_linkage is not None
    static = dataclasses.replace(static, flux_linkage=static.flux_linkage + leakage * static.current)
    both, _ = table_from_measurements(static, NOISE)
    alone, report = table_from_measurements(dataclasses.replace(static, flux_linkage=None), NOISE)
    assert report.flux_linkage_residual is None
    assert any("up to a function of the current" in note for note in report.notes)
    i, g = inner_points()
    missing = both.flux_linkage(i, g) - alone.flux_linkage(i, g)
    assert missing == pytest.approx(leakage * i, abs=0.05 * leakage * I_MAX)
    assert deviation(alone, saturating_reluctance)["force"] < 8


def test_noise_of_current_and_position_counts() -> None:
    """Rows with a coarse gap reading fit within their noise only where that is stated."""
    static = scattered(saturating_reluctance, 400)
    rng = np.random.default_rng(5)
    blurred = dataclasses.replace(static, gap=static.gap + 1e-6 * rng.standard_normal(static.gap.size))
    silent = table_from_measurements(blurred, NOISE)[1]
    said = table_from_measurements(blurred, Noise(force="0.5 N", flux_linkage="50 uWb", position="1 um"))[1]
    assert silent.force_residual is not None
    assert said.force_residual is not None
    assert silent.force_residual > 2
    assert any("times the stated noise" in note for note in silent.notes)
    assert said.force_residual == pytest.approx(1, abs=0.2)


def test_held_out_rows_are_judged_and_not_fitted(fitted) -> None:
    table, _ = fitted
    fit, held = scattered(saturating_reluctance), scattered(saturating_reluctance, 80, seed=9)
    assert fit.force is not None
    assert held.force is not None
    assert fit.flux_linkage is not None
    assert held.flux_linkage is not None
    together = StaticMap(
        gap=np.r_[fit.gap, held.gap],
        current=np.r_[fit.current, held.current],
        force=np.r_[fit.force, held.force],
        flux_linkage=np.r_[fit.flux_linkage, held.flux_linkage],
        role=np.r_[fit.role, np.full(80, "held-out")],
    )
    same, report = table_from_measurements(together, NOISE)
    assert np.array_equal(same.nodes["force"], table.nodes["force"])
    assert report.held_out_force_residual == pytest.approx(1, abs=0.25)
    assert report.held_out_flux_linkage_residual == pytest.approx(1, abs=0.25)


def test_thin_region_is_said() -> None:
    static = scattered(saturating_reluctance, 400)
    hole = (np.abs(static.current) > 4) & (np.abs(static.current) < 10) & (static.gap > 4e-4) & (static.gap < 9e-4)
    kept = ~hole
    with_hole = measure(saturating_reluctance, static.current[kept], static.gap[kept])
    _, report = table_from_measurements(with_hole, NOISE)
    assert 0 < report.thin_cells < 0.3 * report.cells
    (note,) = report.notes
    assert "data are thin" in note
    near = note.split("worst near ")[1].split(" A")[0]
    assert 5 < float(near) < 9


def test_inductance_stays_positive_where_noise_would_bend_it() -> None:
    """Deep saturation, few and coarse rows: the floor holds, and is active."""
    rng = np.random.default_rng(3)
    i, g = rng.uniform(0, 40, 60), rng.uniform(G_MIN, G_MAX, 60)
    value = saturating_reluctance(i, g)
    rough = StaticMap(
        gap=g,
        current=i,
        force=None,
        flux_linkage=value["flux_linkage"] + 4e-3 * rng.standard_normal(60),
        role=np.full(60, "fit"),
    )
    table, _ = table_from_measurements(rough, Noise(flux_linkage="0.2 mWb"))
    current, gap = (v.ravel() for v in np.meshgrid(table.current, table.gap))
    base = SaturatingReluctance(**table.provenance["reluctance"])
    share = table.nodes["incremental_inductance"].ravel() / base.derivatives(current, gap)[2, 0]
    assert share.min() == pytest.approx(FLOOR, rel=0.01)


# --- the grid and refusals --------------------------------------------------------------------------------------------


def test_table_spans_the_measurements_and_no_more(fitted) -> None:
    table, _ = fitted
    assert table.gap[[0, -1]] == pytest.approx([G_MIN, G_MAX])
    assert table.current[[0, -1]] == pytest.approx([0, I_MAX])
    static = scattered(saturating_reluctance)
    own, _ = table_from_measurements(static, NOISE, gaps=[2.5e-4, 4e-4, 6e-4, 9e-4], currents=[1, 2, 4, 8])
    assert own.current.tolist() == [0, 1, 2, 4, 8]
    for gaps, currents in (
        ([1e-4, 5e-4, 9e-4], None),
        ([3e-4, 5e-4, 1.1e-3], None),
        (None, [1.0, 5.0, 13.0]),
        (None, [1.0, np.nan, 3.0]),
    ):
        with pytest.raises(InputError, match=r"leaves the measurements: gaps 0\.2 \.\.\. 1 mm and currents up to 12 A"):
            table_from_measurements(static, NOISE, gaps=gaps, currents=currents)


def test_unstated_noise_is_refused() -> None:
    with pytest.raises(InputError, match=r"noise of flux_linkage_Wb is not stated.*\[noise\] flux_linkage"):
        table_from_measurements(scattered(saturating_reluctance), Noise(force="0.5 N"))


def test_too_few_rows_are_refused() -> None:
    with pytest.raises(InputError, match="too few for a table"):
        table_from_measurements(scattered(saturating_reluctance, 9), NOISE)
    one_gap = measure(saturating_reluctance, np.linspace(1, 12, 50), np.full(50, 5e-4))
    with pytest.raises(InputError, match="at 1 gaps"):
        table_from_measurements(one_gap, NOISE)
    held_out = dataclasses.replace(scattered(saturating_reluctance), role=np.full(300, "held-out"))
    with pytest.raises(InputError, match='role "fit"'):
        table_from_measurements(held_out, NOISE)


def test_rows_of_no_magnet_are_refused() -> None:
    """A pushing force, or a flux against the current: signs or units are wrong."""
    static = scattered(saturating_reluctance)
    assert static.force is not None
    assert static.flux_linkage is not None
    for wrong in (
        dataclasses.replace(static, force=-static.force, flux_linkage=None),
        dataclasses.replace(static, flux_linkage=-static.flux_linkage, force=None),
    ):
        with pytest.raises(ComputationError, match="not those of a reluctance magnet"):
            table_from_measurements(wrong, NOISE)


# --- the command ------------------------------------------------------------------------------------------------------


def test_command_fits_a_record(tmp_path: Path, capfd) -> None:
    record = tmp_path / "rig"
    record.mkdir()
    actuator = ROOT / "geometries" / "fast_tool_servo.toml"
    (record / "rig.toml").write_text(
        f'schema = 1\norigin = "simulated"\nactuator = "{actuator}"\n[noise]\nforce = "0.5 N"\n'
        'flux_linkage = "50 uWb"\n[static]\nrole = "fit"\n'
    )
    static = scattered(saturating_reluctance)
    columns = np.stack([static.gap, static.current, static.force, static.flux_linkage], axis=1)
    lines = [",".join(map(repr, map(float, row))) for row in columns]
    (record / "static.csv").write_text("\n".join(["gap_m,current_A,force_N,flux_linkage_Wb", *lines]) + "\n")
    output = tmp_path / "t.nc"
    arguments = ["table", str(actuator), "--measured", str(record), "-o", str(output), "--json"]
    status = run_guarded(lambda: app(arguments))
    out, err = capfd.readouterr()
    assert status == 0, err
    said = json.loads(out)
    assert said["table"] == str(output)
    assert said["force_residual"] == pytest.approx(1, abs=0.15)
    table = read_table(output)
    assert set(table.nodes) == set(NODES)
    assert table.provenance["record"] == "rig"
    assert table.provenance["stated_noise"] == {"force": 0.5, "flux_linkage": pytest.approx(5e-5)}
    assert deviation(table, saturating_reluctance)["force"] < 3
    assert run_guarded(lambda: app([*arguments, "--resume"])) == 2
    assert "--measured solves no fields" in capfd.readouterr().err
    assert run_guarded(lambda: app([*arguments[:3], str(tmp_path), *arguments[4:]])) == 2
