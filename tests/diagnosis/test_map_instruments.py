"""Errors of the instruments of a static map: zero and asymmetry of the flux linkage, and curves of gauges."""

from dataclasses import replace

import numpy as np
import pytest
from sprung import record as shaken

from msl_fem.actuator import parse_actuator
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.errors import RecordError
from msl_fem.record import Noise, Record, StaticMap, Tolerance, load_record, write_record
from msl_fem.record.columns import write_columns
from msl_fem.record.loop_table import table_of_loops
from msl_fem.record.rig_file import RigFile
from msl_fem.record.static_file import read_static

RING = {"schema": 1, "name": "ring", "magnet": {"kind": "table", "table": "none.nc"},
        "sides": {"count": 1, "magnets_per_side": 1}}  # fmt: skip
ZERO, UNEVEN, NOISE = 6e-3, 0.03, 1e-3


def ring() -> StaticMap:
    """Flux linkage over a current of both signs, up and down twice, without hysteresis."""
    current = np.concatenate([np.linspace(-1, 1, 40), np.linspace(1, -1, 40)] * 2)
    role = np.repeat(["fit", "held-out"], 80)
    flux = np.tanh(1.3 * current) + NOISE * np.random.default_rng(3).standard_normal(current.size)
    return StaticMap(np.full(current.size, 1e-3), current, None, flux, role, sequence=np.repeat([0.0, 1.0], 80))


def spoilt() -> StaticMap:
    """Read by an instrument with a zero that reads more of positive values and less of negative ones."""
    rows = ring()
    flux = rows.flux_linkage * (1 + UNEVEN * np.sign(rows.flux_linkage)) + ZERO
    return replace(rows, flux_linkage=flux)


def record(rows: StaticMap, tolerance: Tolerance) -> Record:
    noise = Noise(flux_linkage=NOISE, current=1e-5)
    return Record("measured", parse_actuator(RING), noise=noise, tolerance=tolerance, static=rows)


def test_zero_and_asymmetry_of_an_integrator_are_no_cause() -> None:
    """Stated as possible they are found, in their intervals; left out what they make is left as excess."""
    how = DiagnosisSettings(table=table_of_loops(ring()))
    known = Tolerance(flux_linkage_zero=0.01, flux_linkage_asymmetry=0.05, current_zero=1e-6, current_gain=1e-6)
    found = diagnose(record(spoilt(), known), how)
    assert (found.verdict, found.names) == ("nothing-found", ())
    for name, truth in (("flux_linkage_zero", ZERO), ("flux_linkage_asymmetry", UNEVEN)):
        told = found.parameters[name]
        assert told.low < truth < told.high
        assert told.value == pytest.approx(truth, rel=0.1)
    bare = Tolerance(current_zero=1e-6, current_gain=1e-6)
    assert diagnose(record(spoilt(), bare), how).verdict != "nothing-found"


def test_a_gauge_s_curve_is_applied_to_the_rows(tmp_path) -> None:
    """A flux meter that compresses: read through its curve the rows are those of the linear one."""
    rows, path = ring(), tmp_path / "static.csv"
    columns = {"gap_m": rows.gap, "current_A": rows.current, "flux_linkage_Wb": np.sinh(rows.flux_linkage)}
    write_columns(path, columns)
    value = np.linspace(-1.2, 1.2, 61)
    write_columns(tmp_path / "meter.csv", {"reading": np.sinh(value), "value": value})
    entry = {"role": "fit", "curves": {"flux_linkage_Wb": "meter.csv"}}
    rig = RigFile.model_validate({"schema": 1, "origin": "measured", "actuator": "ring", "static": entry})
    np.testing.assert_allclose(read_static(rig, path).flux_linkage, rows.flux_linkage, atol=2e-5)
    write_columns(tmp_path / "meter.csv", {"reading": np.array([-0.5, 0, 0.5]), "value": np.array([-0.5, 0, 0.5])})
    with pytest.raises(RecordError, match=r"lies beyond the curve meter\.csv"):
        read_static(rig, path)


def test_a_position_sensor_s_own_signal(tmp_path) -> None:
    """`position_sensor_V` with its curve is the position; without one, and beside a position, it is refused."""
    folder, whole = tmp_path / "rig", shaken()
    write_record(whole, folder)
    for run in whole.runs:
        volt = np.tan(run["position_m"] / 1e-3)
        path = folder / run.file
        rows = [f"{t:.9g},{f:.9g},{u:.12g}" for t, f, u in zip(run.time, run["force_N"], volt, strict=True)]
        path.write_text("time_s,force_N,position_sensor_V\n" + "\n".join(rows) + "\n")
    with pytest.raises(RecordError, match="position_sensor_V is a signal; name a file"):
        load_record(folder)
    top = max(float(np.abs(run["position_m"]).max()) for run in whole.runs) * 1.05
    value = np.linspace(-top, top, 81)
    rows = "\n".join(f"{np.tan(v / 1e-3):.12g},{v:.12g}" for v in value)
    (folder / "probe.csv").write_text(f"reading,value\n{rows}\n")
    rig = folder / "rig.toml"
    rig.write_text('position_sensor_curve = "probe.csv"\n' + rig.read_text())
    for run, read in zip(whole.runs, load_record(folder).runs, strict=True):
        np.testing.assert_allclose(read["position_m"], run["position_m"], atol=1e-4 * top)
    write_record(whole, tmp_path / "again")
    for run in whole.runs:
        text = (tmp_path / "again" / run.file).read_text().replace("true_velocity", "position_sensor_V")
        (folder / run.file).write_text(text)
    with pytest.raises(RecordError, match="remove one"):
        load_record(folder)
