"""What a notebook sees of each record: a line with units, a table of facts, a picture, frames."""

import io
import re

import numpy as np
import pandas as pd
import pytest
from conftest import ROOT
from matplotlib.figure import Figure

import msl_fem
from msl_fem.actuator import Actuator
from msl_fem.diagnosis.result import ChannelResiduals, Diagnosis, Evidence, TriedVariant
from msl_fem.errors import InputError, RecordError
from msl_fem.files.shown import Shown
from msl_fem.plant.simulate import NamedRun, Simulation
from msl_fem.record import FrameLabels, Record
from msl_fem.report.notebook import picture_of, prefixed
from msl_fem.table.magnetic_table import MagneticTable

RATE = 10e3
STEP = "step:amplitude=0.05 A,bias=0.3 A,duration=0.12 s"


@pytest.fixture(scope="module")
def simulation(servo: Actuator, table: MagneticTable) -> Simulation:
    return msl_fem.simulate(servo, table, msl_fem.excitation_inputs(servo, STEP, rate=RATE))


@pytest.fixture(scope="module")
def record(servo: Actuator, simulation: Simulation) -> Record:
    return msl_fem.simulation_record(servo, [NamedRun("step", STEP, "fit", simulation)])


def diagnosis_of_two_effects() -> Diagnosis:
    """The evidence of a search, written by hand: a delay that explains a position."""
    t = np.arange(2000) / RATE
    believed = 1e-6 * np.sin(2 * np.pi * 20 * t)
    channel = ChannelResiduals("noise", "held-out", "position_m", RATE, 1e-8, believed, 0.5 * believed, 0.01 * believed)
    tried = (
        TriedVariant(1, "time_delay", "a", 900.0, 950.0, True), TriedVariant(1, "time_delay", "b", 800.0, None, False),
        TriedVariant(1, "coulomb_friction", "a", 40.0, None, False),
    )  # fmt: skip
    evidence = Evidence(tried=tried, residuals=(channel,), variables={}, sizes=())
    return Diagnosis("unexplained", "the delay is drawn", threshold=12.0, evidence=evidence)


@pytest.fixture(scope="module")
def records(servo: Actuator, table: MagneticTable, simulation: Simulation, record: Record) -> dict[str, Shown]:
    point = msl_fem.solve(servo, 2.0, 0.6e-3, accuracy="fast")
    frame = table.to_pandas().reset_index()[["gap_m", "current_A", "force_N"]]
    rows = frame[frame["gap_m"] > 1e-4]
    static = msl_fem.record_from_frames(servo, static=rows, labels=FrameLabels(origin="simulated")).static
    shown = (servo, table, msl_fem.operating_map(table), point, simulation, record, record.runs[0], static)
    return {type(it).__name__: it for it in (*shown, diagnosis_of_two_effects())}


KINDS = {
    "Actuator": "fast_tool_servo",
    "MagneticTable": "20 gaps x 20 currents",
    "OperatingMap": "1.2, 1.6 T",
    "PointResult": r"force [\d.]+ N ± [\d.]+ %",
    "Simulation": r"samples 1200 at 10 kHz, position at most [\d.]+ µm, current 1 at most [\d.]+ mA",
    "Record": r"rig fast_tool_servo, origin simulated, to fit step",
    "Run": "samples 1200 in 119.9 ms, role fit",
    "StaticMap": "gap 0.1... 1.2 mm|rows",
    "Diagnosis": "verdict unexplained",
}


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_shows_itself(records: dict[str, Shown], kind: str) -> None:
    it = records[kind]
    line = repr(it)
    assert re.search(KINDS[kind], line), line
    assert line.startswith(f"{kind}(")
    assert len(line) < 400, "a line, no dump"
    html = it._repr_html_()
    assert all(f"<th>{name}</th>" in html for name in it.facts())
    figure = it.plot()
    assert isinstance(figure, Figure)
    assert figure._repr_png_().startswith(b"\x89PNG"), "shown without pyplot"
    assert any(axes.has_data() or axes.texts for axes in figure.axes)


def test_texts_of_a_file_are_no_markup(record: Record) -> None:
    named = Record("measured", record.actuator.model_copy(update={"name": "<b>&"}), runs=record.runs)
    assert "<b>&" not in named._repr_html_()
    assert "&lt;b&gt;&amp;" in named._repr_html_()


def test_curves_of_a_table_are_its_force(table: MagneticTable) -> None:
    figure = table.plot(gaps=[0.5e-3])
    [force, flux] = [axes.lines[0].get_ydata()[-1] for axes in figure.axes]
    assert force == table.force(12.0, 0.5e-3)
    assert flux == 1e3 * table.evaluate(12.0, 0.5e-3)["flux_linkage"]
    with pytest.raises(InputError, match="outside the table"):
        table.plot(gaps=[5e-3])


def test_a_picture_is_written_without_a_window(table: MagneticTable) -> None:
    stream = io.BytesIO()
    table.plot().savefig(stream, format="svg")
    assert b"coil current in A" in stream.getvalue()


def test_what_has_no_picture_says_so() -> None:
    with pytest.raises(TypeError, match="no picture of a int"):
        picture_of(3)
    with pytest.raises(InputError, match="no picture: too short"):
        Diagnosis("undecidable", "too short").plot()


@pytest.mark.parametrize(
    ("largest", "shown"), [(2e-5, ("µm", 1e6)), (0.02, ("mm", 1e3)), (3.0, ("m", 1.0)), (0, ("m", 1.0))]
)
def test_signals_have_the_prefix_that_is_read(largest: float, shown: tuple[str, float]) -> None:
    assert prefixed("m", largest) == shown


def test_frames_hold_the_records_own_numbers(simulation: Simulation, table: MagneticTable) -> None:
    frame, data = simulation.to_pandas(), simulation.to_xarray()
    np.testing.assert_array_equal(frame["current_2_A"], simulation.current[:, 1])
    np.testing.assert_array_equal(data["position_m"], simulation.position)
    assert data["velocity_m_per_s"].attrs["units"] == "m/s"
    assert data["time_s"].attrs["units"] == frame.index.name.rpartition("_")[2] == "s"
    rows = table.to_pandas()
    gap, current = float(table.gap[3]), float(table.current[5])
    assert rows.loc[(gap, current), "force_N"] == table.nodes["force"][3, 5] == table.to_xarray()["force"][3, 5]
    frame.iloc[0, 0] = 7.0  # a copy: a frame is edited, a record is not
    assert simulation.position[0] != 7.0


def test_a_record_goes_through_frames_and_back(servo: Actuator, record: Record, tmp_path) -> None:
    labels = FrameLabels(origin="simulated", held_out=["again"], noise=record.noise)
    frames = {"step": record.runs[0].to_pandas(), "again": record.runs[0].to_pandas().reset_index()}
    made = msl_fem.record_from_frames(servo, frames, labels=labels)
    msl_fem.write_record(made, tmp_path / "r")
    there = msl_fem.load_record(tmp_path / "r")
    assert [(run.name, run.role) for run in there.runs] == [("step", "fit"), ("again", "held-out")]
    assert there.sampling is not None
    assert there.sampling.rate == RATE
    for name, values in record.runs[0].columns.items():
        np.testing.assert_allclose(there.runs[1][name], values, rtol=1e-8, atol=1e-15)


def test_frames_that_are_no_record_are_refused(servo: Actuator, record: Record) -> None:
    frame = record.runs[0].to_pandas()
    with pytest.raises(RecordError, match="column position_m is missing"):
        msl_fem.record_from_frames(servo, {"a": frame.drop(columns="position_m")})
    with pytest.raises(RecordError, match="no run 'b' among the frames; there are a"):
        msl_fem.record_from_frames(servo, {"a": frame}, labels=FrameLabels(held_out=["b"]))
    spoiled = frame.copy()
    spoiled.iloc[7, 1] = np.nan
    with pytest.raises(RecordError, match="a: "):
        msl_fem.record_from_frames(servo, {"a": spoiled})
    with pytest.raises(RecordError, match="at least 200"):
        msl_fem.record_from_frames(servo, {"a": frame.iloc[:150]})


def test_a_frame_with_names_of_its_own_is_imported(servo: Actuator, record: Record) -> None:
    run = record.runs[0]
    frame = pd.DataFrame({"t_ms": 1e3 * run.time, "x_um": 1e6 * run["position_m"], "text": "a"})
    for side in (1, 2):
        frame[f"I{side}"] = run[f"current_{side}_A"]
    columns = "time_s=t_ms:unit=ms,position_m=x_um:unit=um,current_1_A=I1,current_2_A=I2"
    imported = msl_fem.import_log(frame, columns, servo).run
    np.testing.assert_allclose(imported["position_m"], run["position_m"], atol=1e-18)
    with pytest.raises(RecordError, match="no columns of numbers"):
        msl_fem.import_log(frame[["text"]], columns, servo)


def test_each_command_has_its_function() -> None:
    """docs/python.md names a function of the package for each command, or says why there is none."""
    from msl_fem.cli.app import COMMANDS

    text = (ROOT / "docs" / "python.md").read_text()
    told = dict(re.findall(r"^\| `([a-z-]+)` \| (.*) \|$", text, flags=re.MULTILINE))
    assert set(told) == set(COMMANDS)
    verbs = {name for cell in told.values() for name in re.findall(r"`(\w+)`", cell)}
    assert verbs | {"load_actuator", "load_record", "write_record"} == set(msl_fem.__all__)
    assert all(callable(getattr(msl_fem, verb)) for verb in msl_fem.__all__)
    alone = [command for command, cell in told.items() if "the command alone" in cell]
    assert alone == ["calibrate", "doctor"]
