"""A second input that changes parameters, and motions that a machine imposes: what runs of both tell."""

from dataclasses import replace

import numpy as np
import pytest
import sprung

from msl_fem.diagnosis import diagnose
from msl_fem.errors import InputError, RecordError
from msl_fem.identification import identify
from msl_fem.record import Noise, Record, Run, Sampling, Tolerance, load_record, write_record
from msl_fem.record.rig_file import Scheduling

RATE, N = 500.0, 5000
STIFFNESS, DAMPING, RISE = 4e3, 60.0, 2.0
COLUMN = "coil_voltage_V"


def on_a_machine(name: str, role: str, seed: int) -> Run:
    """A spring and a damper on a testing machine: sines impose the motion, the force is read; the damping goes up by
    `RISE` times itself over 1 V of a slow second input."""
    rng, time = np.random.default_rng(seed), np.arange(N) / RATE
    x, v, a = np.zeros(N), np.zeros(N), np.zeros(N)
    for frequency in (2.3, 4.1, 7.9):
        w, phase = 2 * np.pi * frequency, rng.uniform(0, 6.28)
        x += 2e-3 * np.sin(w * time + phase)
        v += 2e-3 * w * np.cos(w * time + phase)
        a -= 2e-3 * w**2 * np.sin(w * time + phase)
    voltage = 0.5 + 0.5 * np.sin(2 * np.pi * 0.11 * time + seed)
    force = 2.0 * a + DAMPING * (1 + RISE * voltage) * v + STIFFNESS * x
    force += 0.02 * rng.standard_normal(N)
    columns = {"time_s": time, "force_N": force, "position_m": x + 1e-8 * rng.standard_normal(N)}
    return Run(name, "sines", role, columns, extra={COLUMN: voltage}, mover="imposed")


def machine(*changes: str) -> Record:
    runs = (on_a_machine("a", "fit", 1), on_a_machine("b", "held-out", 2))
    known = Tolerance(stiffness=0.1, damping=0.5)
    scheduling = (Scheduling(column=COLUMN, changes=changes, at=(0.0, 1.0)),) if changes else ()
    noise = Noise(position=1e-8, force=0.02)
    actuator = sprung.shaker().model_copy(
        update={"motion": sprung.shaker().motion.model_copy(update={"stiffness": 3.8e3, "damping": 50.0})}
    )
    return Record("measured", actuator, Sampling(rate=RATE), noise, known, runs=runs, scheduling=scheduling)


def test_a_damping_that_a_second_input_changes() -> None:
    """Its values at both ends and the spring's, to 0.1 % and in their intervals, and no cause is made of it."""
    found = diagnose(machine("damping"))
    assert (found.verdict, found.names) == ("nothing-found", ())
    (told,) = found.scheduling
    for value, truth in zip(told.values, (DAMPING, DAMPING * (1 + RISE)), strict=True):
        assert value.low < truth < value.high
        assert value.value == pytest.approx(truth, rel=1e-3)
    assert found.parameters["stiffness"].value == pytest.approx(STIFFNESS, rel=1e-3)
    assert found.to_json()["scheduling"][0]["at"] == [0.0, 1.0]


def test_left_out_it_is_unexplained() -> None:
    """Nothing of the catalogue passes for it, and no damping fits both ends."""
    found = diagnose(machine())
    assert (found.verdict, found.names) == ("unexplained", ())
    assert min(one.extended.rms / one.extended.floor for one in found.accuracy) > 100


def stepped() -> Record:
    """Free runs of a shaken mover, each at one value of what damps it: to fit 0 and 1, held out 0.5."""
    runs = []
    for name, role, value, seed in (("a", "fit", 0.0, 1), ("b", "fit", 1.0, 2), ("c", "held-out", 0.5, 3)):
        rng = np.random.default_rng(seed)
        force = np.repeat(rng.choice([-4.0, 4.0], sprung.N // 20), 20)
        position = sprung.motion_under(force, damping=sprung.DAMPING * (1 + value))[:, 0]
        position += sprung.SIGMA * rng.standard_normal(sprung.N)
        columns = {"time_s": np.arange(sprung.N) / sprung.RATE, "force_N": force, "position_m": position}
        runs.append(Run(name, "steps", role, columns, extra={COLUMN: np.full(sprung.N, value)}))
    scheduling = (Scheduling(column=COLUMN, changes=("damping",)),)
    sampling, noise = Sampling(rate=sprung.RATE), Noise(position=sprung.SIGMA)
    return Record("measured", sprung.shaker(), sampling, noise, runs=tuple(runs), scheduling=scheduling)


def test_runs_at_different_values_of_it_are_followed_together(tmp_path) -> None:
    """The damping at each within its interval, and the held-out run between them at its noise; read back from files in
    which the values stand in the runs' entries."""
    write_record(stepped(), tmp_path / "rig")
    text = (tmp_path / "rig" / "rig.toml").read_text()
    for name in "abc":
        lines = (tmp_path / "rig" / f"{name}.csv").read_text().splitlines()
        (tmp_path / "rig" / f"{name}.csv").write_text("\n".join(line.rpartition(",")[0] for line in lines))
    for name, value in (("a", 0), ("b", 1), ("c", 0.5)):
        text = text.replace(f'file = "{name}.csv"', f'file = "{name}.csv"\nlevels = {{ {COLUMN} = {value} }}')
    (tmp_path / "rig" / "rig.toml").write_text(text)
    record = load_record(tmp_path / "rig")
    assert not [told for told in record.warnings if COLUMN in told]
    found = diagnose(record)
    assert (found.verdict, found.names) == ("nothing-found", ())
    for value, truth in zip(found.scheduling[0].values, (sprung.DAMPING, 2 * sprung.DAMPING), strict=True):
        assert value.low < truth < value.high
        assert value.value == pytest.approx(truth, rel=0.01)
    (held,) = (one.extended for one in found.accuracy if one.extended.role == "held-out")
    assert held.rms == pytest.approx(sprung.SIGMA, rel=0.1)


def test_what_cannot_be_is_refused() -> None:
    record = stepped()
    without = replace(record, runs=(*record.runs[:2], replace(record.runs[2], extra={})))
    one_value = replace(record, runs=(record.runs[0], record.runs[2]))
    moving = replace(record.runs[0], extra={COLUMN: np.linspace(0, 1, sprung.N)})
    other = (Scheduling(column=COLUMN, changes=("colour",)),)
    for bad, said in (
        (without, "run c has no numbers in a column coil_voltage_V"),
        (one_value, "has one value in all runs that are fitted"),
        (replace(record, runs=(moving, *record.runs[1:])), "goes from 0 to 1; a run that is simulated has one value"),
        (replace(record, scheduling=other), "'colour' cannot go with a second input; there are moving_mass"),
    ):
        with pytest.raises(InputError, match=said):
            diagnose(bad)
    with pytest.raises(RecordError, match="go with coil_voltage_V, which only 'msl-fem diagnose' takes"):
        identify(record)


def test_a_mover_that_cannot_tell_is_refused(tmp_path) -> None:
    record = machine()
    write_record(record, tmp_path / "machine")
    assert load_record(tmp_path / "machine").runs[0].mover == "imposed"
    locked = replace(record, runs=tuple(replace(run, mover="locked") for run in record.runs))
    mixed = replace(record, runs=(record.runs[0], replace(record.runs[1], mover="free")))
    for bad, said in ((locked, "tells nothing while its mover is locked"), (mixed, "make a record of each")):
        with pytest.raises(RecordError, match=said):
            write_record(bad, tmp_path / "bad")
