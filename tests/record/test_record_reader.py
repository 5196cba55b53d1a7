"""Records are read with what rig.toml states, or refused by file, row and column."""

from pathlib import Path

import numpy as np
import pytest
from small_record import RIG, columns, make, write_csv

from msl_fem.errors import ActuatorError, InputError, RecordError
from msl_fem.record.reader import load_record
from msl_fem.record.writer import write_record

ROOT = Path(__file__).parent.parent.parent


@pytest.fixture(autouse=True)
def _in_the_project(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT / "tests")


def refused(folder: Path, *said: str, kind: type[InputError] = RecordError) -> None:
    """The record is refused in one line that says all of `said`."""
    with pytest.raises(kind) as caught:
        load_record(folder)
    message = str(caught.value)
    assert "\n" not in message
    for text in said:
        assert text in message


def test_a_record_is_read(tmp_path: Path) -> None:
    table = columns()
    record = load_record(make(tmp_path / "r", noise=table))
    assert (record.origin, record.warnings, record.static) == ("measured", (), None)
    assert [(run.name, run.file, run.role, run.excitation) for run in record.runs] == [
        ("noise", "noise.csv", "fit", "band-limited noise"),
        ("sweep", "sweep.csv", "held-out", "swept sine"),
    ]
    run = record.run("noise")
    assert record.runs_of("fit") == (run,)
    assert set(run.columns) == set(table)
    for name, values in table.items():
        assert run[name].tolist() == values.tolist()
    assert run.sampling_period == pytest.approx(1e-4, rel=1e-12)
    assert record.sampling is not None
    assert (record.sampling.rate, record.sampling.hold) == (10e3, "zero-order")
    assert record.actuator.motion is not None
    assert record.actuator.motion.nominal_gap == 0.6e-3
    assert "flux_linkage_1_Wb" not in run
    with pytest.raises(RecordError, match="has no column flux_linkage_1_Wb; it has time_s, voltage_1_V"):
        run["flux_linkage_1_Wb"]
    with pytest.raises(RecordError, match="no run 'sine'"):
        record.run("sine")


def test_columns_cannot_be_written_to(tmp_path: Path) -> None:
    run = load_record(make(tmp_path / "r")).run("noise")
    with pytest.raises(ValueError, match="read-only"):
        run["position_m"][0] = 1.0


def test_tolerances_left_out_have_the_formats_values(tmp_path: Path) -> None:
    rig = RIG.replace("[[run]]", "[tolerance]\nmoving_mass = 0.01\n[[run]]", 1)
    assert load_record(make(tmp_path / "r", rig=rig)).tolerance.model_dump() == {
        "moving_mass": 0.01,
        "stiffness": 0.02,
        "damping": 0.2,
        "coil_resistance": 0.01,
        "nominal_gap": 0.005,
        "position_gain": 0.002,
        "magnetic_scale": 0.002,
        "table": 0.001,
        "position_zero": 1e-6,
        "velocity_zero": 1e-3,
        "velocity_gain": 0.005,
        "current_zero": 5e-3,
        "force_zero": 0.05,
        "command_zero": 5e-3,
        "voltage_gain": 0.005,
        "command_gain": 0.005,
        "current_gain": 0.005,
        "force_gain": 0.005,
        "static_gap_zero": 2e-6,
        "force_asymmetry": 0.0,
        "flux_linkage_zero": 0.0,
        "flux_linkage_gain": 0.0,
        "flux_linkage_asymmetry": 0.0,
        "flux_density_zero": 0.0,
        "flux_density_asymmetry": 0.0,
        "leakage_inductance": 0.01,
        "mutual_inductance": 0.003,
    }


def test_tolerances_of_instruments_have_units_and_are_written_so(tmp_path: Path) -> None:
    stated = '[tolerance]\nposition_zero = "2 um"\ncurrent_gain = "1 %"\ncommand_zero = "3 mV"\n[[run]]'
    record = load_record(make(tmp_path / "r", rig=RIG.replace("[[run]]", stated, 1)))
    assert record.tolerance.position_zero == 2e-6
    assert (record.tolerance.current_gain, record.tolerance.command_zero) == (0.01, 3e-3)
    write_record(record, tmp_path / "again")
    assert 'position_zero = "2 um"' in (tmp_path / "again" / "rig.toml").read_text().replace("µ", "u")
    assert load_record(tmp_path / "again").tolerance == record.tolerance
    with pytest.raises(RecordError, match=r"tolerance\.position_zero"):
        load_record(make(tmp_path / "s", rig=RIG.replace("[[run]]", '[tolerance]\nposition_zero = "2 A"\n[[run]]', 1)))
    with pytest.raises(RecordError, match=r"tolerance\.command_zero"):
        load_record(make(tmp_path / "t", rig=RIG.replace("[[run]]", '[tolerance]\ncommand_zero = "2 m"\n[[run]]', 1)))


def test_what_rig_toml_states_overrides_the_actuator(tmp_path: Path) -> None:
    stated = """
[noise]
position = "70 nm"
flux_linkage = "20 uWb"
[motion]
moving_mass = "0.911 kg"
[controller]
law = "lqr"
gains = [1.0, 2.0]
rate = "5 kHz"
[[run]]
"""
    record = load_record(make(tmp_path / "r", rig=RIG.replace("[[run]]", stated, 1)))
    actuator = record.actuator
    assert actuator.motion is not None
    assert actuator.controller is not None
    assert (actuator.motion.moving_mass, actuator.motion.stiffness) == (0.911, 1.4e5)
    assert actuator.position_sensor.noise == pytest.approx(70e-9, rel=1e-14)
    assert (actuator.position_sensor.bandwidth, actuator.current_sensor.noise) == (20e3, 2e-3)
    assert (actuator.controller.rate, actuator.controller.delay_samples) == (5e3, 1)
    assert record.controller == {"law": "lqr", "gains": [1.0, 2.0], "rate": "5 kHz"}
    assert record.noise.flux_linkage == pytest.approx(20e-6)
    assert record.noise.current is None


def test_an_actuator_beside_rig_toml_goes_before_one_of_geometries(tmp_path: Path) -> None:
    text = (ROOT / "geometries" / "fast_tool_servo.toml").read_text(encoding="utf-8")
    folder = make(tmp_path / "r", rig=RIG.replace('"fast_tool_servo"', '"../mine.toml"'))
    refused(folder, "rig.toml: actuator: '../mine.toml' is neither")
    (tmp_path / "mine.toml").write_text(text.replace('"0.90 kg"', '"0.77 kg"'), encoding="utf-8")
    motion = load_record(folder).actuator.motion
    assert motion is not None
    assert motion.moving_mass == 0.77
    (tmp_path / "mine.toml").write_text(text.replace('"0.90 kg"', '"0.77 N"'), encoding="utf-8")
    refused(folder, "mine.toml: motion.moving_mass", kind=ActuatorError)


def test_an_unknown_actuator_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = make(tmp_path / "r")
    monkeypatch.chdir(tmp_path)
    refused(folder, "rig.toml: actuator: 'fast_tool_servo'")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("schema = 1", "schema = 2", "schema: "),
        ("schema = 1", "", "schema: is missing"),
        ('origin = "measured"', 'origin = "guessed"', "origin: "),
        ('rate = "10 kHz"', 'rate = "10 m"', "sampling.rate: unit 'm' has the wrong dimension"),
        ('rate = "10 kHz"', "rate = 10000", "sampling.rate: 10000 has no unit"),
        ('rate = "10 kHz"', 'rat = "10 kHz"', "sampling.rat"),
        ('[sampling]\nrate = "10 kHz"', "", "sampling: is missing"),
        ('role = "fit"', 'role = "train"', "run.0.role: "),
        ('role = "fit"', 'role = "fit"\nweight = "2 kg"', "run.0.weight: unknown key"),
        ('role = "fit"', 'role = "held-out"', 'no run or map has the role "fit"'),
        ("[sampling]", "[noise]\nposition = 5e-8\n[sampling]", "noise.position: 5e-08 has no unit"),
        ("[sampling]", '[noise]\nposition = "5 nV"\n[sampling]', "noise.position: unit 'nV'"),
        ("[sampling]", '[noise]\ngap = "5 nm"\n[sampling]', "noise.gap: unknown key"),
        ("[sampling]", "[tolerance]\nmass = 0.1\n[sampling]", "tolerance.mass: unknown key"),
        ("[sampling]", "[tolerance]\nstiffness = -0.1\n[sampling]", "tolerance.stiffness: "),
        ("[sampling]", "[motion]\nmoving_mass = 0.9\n[sampling]", "motion.moving_mass: 0.9 has no unit"),
        ("[sampling]", '[motion]\nmass = "0.9 kg"\n[sampling]', "motion.mass: unknown key"),
        ("[sampling]", '[motion]\nrange = "1 mm"\n[sampling]', "motion: range 1 mm must be below"),
        ("[sampling]", "[overrides]\n[sampling]", "overrides: unknown key"),
        ("[sampling]", "[static]\n[sampling]", "static.csv: no such file"),
        ("schema = 1", "schema = ", "not valid TOML"),
        ("noise.csv", "other.csv", "other.csv: no such file"),
        ("noise.csv", "noise.txt", "the ending '.txt' is unknown"),
        ("noise.csv", "../noise.csv", "run.0: file '../noise.csv' leaves the record's folder"),
        ("noise.csv", "/etc/noise.csv", "leaves the record's folder"),
        ('"noise.csv"', "'..\\noise.csv'", "leaves the record's folder"),
        ('"noise.csv"', "'C:noise.csv'", "leaves the record's folder"),
        ("noise.csv", "sweep.csv", "run: the names sweep, sweep are not all different"),
    ],
)
def test_a_faulty_rig_is_refused_by_its_key_path(tmp_path: Path, old: str, new: str, said: str) -> None:
    assert old in RIG
    refused(make(tmp_path / "r", rig=RIG.replace(old, new, 1)), said, str(tmp_path / "r"))


def test_a_folder_without_rig_toml_is_no_record(tmp_path: Path) -> None:
    refused(tmp_path, "rig.toml: cannot be read")


def test_a_link_out_of_the_folder_is_refused(tmp_path: Path) -> None:
    folder = make(tmp_path / "r")
    (folder / "noise.csv").rename(tmp_path / "secret.csv")
    (folder / "noise.csv").symlink_to(tmp_path / "secret.csv")
    refused(folder, "noise.csv: the file lies outside the record's folder")


def test_noise_stated_twice_is_refused(tmp_path: Path) -> None:
    twice = '[noise]\nposition = "5 nm"\n[position_sensor]\nnoise = "6 nm"\n[sampling]'
    refused(make(tmp_path / "r", rig=RIG.replace("[sampling]", twice)), "position_sensor.noise and noise.position")


def test_runs_need_a_drive(tmp_path: Path) -> None:
    (tmp_path / "cart.toml").write_text('schema = 1\nname = "cart"\n[motion]\nmoving_mass = "1 kg"\n')
    rig = RIG.replace("fast_tool_servo", "../cart.toml")
    refused(make(tmp_path / "r", rig=rig), "rig.toml: run: the actuator 'cart' has no [drive]")


def static_only(folder: Path, static: str, *, section: str = '[static]\nrole = "fit"\n') -> Path:
    folder.mkdir()
    (folder / "rig.toml").write_text(f'schema = 1\norigin = "measured"\nactuator = "e1"\n{section}')
    (folder / "static.csv").write_text(static)
    return folder


def test_a_static_only_rig_keeps_the_order_of_its_rows(tmp_path: Path) -> None:
    text = "gap_m,current_A,force_N,direction,sequence\n1e-3,0,0.5,up,1\n1e-3,2,9,up,1\n1e-3,0,0.7,down,2\n"
    record = load_record(static_only(tmp_path / "s", text))
    static = record.static
    assert static is not None
    assert static.direction is not None
    assert (record.runs, record.sampling, static.flux_linkage) == ((), None, None)
    assert static.current.tolist() == [0.0, 2.0, 0.0]
    assert static.direction.tolist() == ["up", "up", "down"]
    assert static.sequence is not None
    assert static.sequence.tolist() == [1, 1, 2]
    assert static.rows("fit").tolist() == [0, 1, 2]


def test_a_column_role_goes_before_the_sections(tmp_path: Path) -> None:
    text = "gap_m,current_A,force_N,role\n1e-3,0,0,fit\n1e-3,1,2,held-out\n"
    for section in ("", "[static]\n", '[static]\nrole = "held-out"\n'):
        static = load_record(static_only(tmp_path / f"s{len(section)}", text, section=section)).static
        assert static is not None
        assert (static.rows("fit").tolist(), static.rows("held-out").tolist()) == ([0], [1])


@pytest.mark.parametrize(
    ("text", "section", "said"),
    [
        (
            "gap_m,current_A\n1e-3,1\n",
            '[static]\nrole = "fit"',
            "row 1: column force_N or flux_linkage_Wb or flux_density_T is missing",
        ),
        ("gap_mm,current_A,force_N\n1,1,1\n", '[static]\nrole = "fit"', "column gap_m is missing; the file has gap_mm"),
        ("gap_m,current_A,force_N\n1e-3,1,2\n", "", "rig.toml: static: static.csv is there"),
        ("gap_m,current_A,force_N\n1e-3,1,2\n", "[static]", "row 1: column role is missing"),
        ("gap_m,current_A,force_N\n1e-3,1,2\n", '[static]\nrole = "held-out"', 'no run or map has the role "fit"'),
        ("gap_m,current_A,force_N\n", '[static]\nrole = "fit"', "row 2: there are no rows"),
        ("gap_m,current_A,force_N\n1e-3,1,2\n-1e-3,1,2\n", '[static]\nrole = "fit"', "row 3 (sample 1), column gap_m"),
        ("gap_m,current_A,force_N\n1e-3,1,x\n", '[static]\nrole = "fit"', "row 2 (sample 0), column force_N: 'x'"),
        ("gap_m,current_A,force_N,role\n1e-3,1,2,test\n", "", "column role: 'test' is none of fit, held-out"),
        (
            "gap_m,current_A,force_N,direction\n1,1,2,left\n",
            '[static]\nrole = "fit"',
            "column direction: 'left' is none of up, down",
        ),
    ],
)
def test_a_faulty_static_map_is_refused(tmp_path: Path, text: str, section: str, said: str) -> None:
    refused(static_only(tmp_path / "s", text, section=section), said)


def test_extra_columns_are_kept_and_named(tmp_path: Path) -> None:
    table = {**columns(), "coolant": np.array(["on"] * 1000), "humidity": np.full(1000, 0.4)}
    record = load_record(make(tmp_path / "r", noise=table))
    assert record.warnings == ("noise.csv: column coolant, humidity is not part of the format; kept, not used",)
    run = record.run("noise")
    assert "humidity" not in run
    assert run.extra["humidity"].tolist() == [0.4] * 1000
    assert run.extra["coolant"].tolist() == ["on"] * 1000


def test_a_bad_cell_of_an_extra_column_is_no_fault(tmp_path: Path) -> None:
    folder = make(tmp_path / "r")
    write_csv(folder / "noise.csv", {**columns(), "note": np.array(["", "nan"] * 500)})
    assert load_record(folder).run("noise").extra["note"].tolist() == ["", "nan"] * 500


def test_the_emps_record_is_whole() -> None:
    record = load_record(ROOT / "measurements" / "emps")
    assert (record.origin, record.warnings) == ("measured", ())
    assert [(run.role, run.time.size) for run in record.runs] == [("fit", 24841), ("held-out", 24841)]
    assert all({"force_N", "position_m", "reference_m"} <= set(run.columns) for run in record.runs)


@pytest.mark.parametrize(("name", "tolerance"), [("emps", 0.02), ("emps_pulses", 0.04)])
def test_the_emps_record_obeys_its_published_inverse_dynamics(name: str, tolerance: float) -> None:
    """M = 95.1 kg, Fv = 203.5 N s/m, Fc = 20.4 N, offset = -3.2 N (Janot, Gautier, Brunot 2019): signs, units, scale.

    Velocity and acceleration are differences over 20 ms of positions averaged alike, as is the force.
    """
    run = load_record(ROOT / "measurements" / "emps").run(name)
    h, period = 20, run.sampling_period
    triangle = np.convolve(np.ones(h), np.ones(h)) / h**2  # a second difference over h is the acceleration under it
    x = run["position_m"]
    acceleration = (x[2 * h :] - 2 * x[h:-h] + x[: -2 * h]) / (h * period) ** 2
    middle = slice(h, -h)

    def averaged(values: np.ndarray) -> np.ndarray:
        return np.convolve(values, triangle, mode="same")[middle]

    velocity = np.gradient(x, period)
    coulomb = averaged(np.sign(np.convolve(velocity, np.ones(h) / h, mode="same")))
    terms = np.column_stack([acceleration, averaged(velocity), coulomb, np.ones(x.size - 2 * h)])
    found = np.linalg.lstsq(terms[::h], averaged(run["force_N"])[::h], rcond=None)[0]
    assert found == pytest.approx([95.109, 203.50, 20.394, -3.165], rel=tolerance)
