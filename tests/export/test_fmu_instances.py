"""The FMU as a guest of other programs: instances, reset, kept states, errors told through the logger."""

import re
import subprocess
import zipfile

import numpy as np
import pytest
from c_programs import compiler
from fmpy.fmi1 import FMICallException
from fmu_master import RATE, Master, exported, steps

from msl_fem.errors import ComputationError, InputError
from msl_fem.export import fmu, fmu_library
from msl_fem.export.formats import ModelSource

CALM = steps([1.0, 0.3], n=60)
ERROR = 3  # fmi2Error


@pytest.fixture(scope="module")
def archive(servo, table, tmp_path_factory):
    return exported(servo, table, tmp_path_factory.mktemp("fmu"))


def same(one, other):
    return all(np.array_equal(one[name], other[name]) for name in one)


def test_reset_and_initialise_again_give_the_same_bits(archive):
    master = Master(archive).initialise(moving_mass=0.7)
    first = master.run(CALM, sides=2)
    master.slave.reset()
    assert master.get("moving_mass", "command_1", "position", "current_1") == [0.9, 0.0, 0.0, 0.0]
    assert same(master.initialise(moving_mass=0.7).run(CALM, sides=2), first)
    master.slave.terminate()
    with pytest.raises(FMICallException):
        master.slave.doStep(0.0, 1 / RATE)
    assert "terminated; reset" in master.said[-1][1]
    master.slave.reset()
    assert not same(master.initialise().run(CALM, sides=2), first)


def test_instances_do_not_know_one_another(archive):
    alone = Master(archive).initialise().run(CALM, sides=2)
    one, two = Master(archive, name="one").initialise(), Master(archive, name="two").initialise(moving_mass=2.0)
    found = []
    for k, row in enumerate(CALM):
        found.append(one.run(row[None], sides=2, start=k))
        two.run(-row[None], sides=2, start=k)
    two.slave.freeInstance()
    assert all(np.array_equal(alone["position"][k], f["position"][0]) for k, f in enumerate(found))
    assert one.get("position") != [0.0]
    one.slave.freeInstance()


def test_a_kept_state_is_gone_back_to(archive):
    master = Master(archive).initialise()
    master.run(CALM[:20], sides=2)
    kept = master.slave.getFMUState()
    told = master.slave.serializeFMUState(kept)
    first = master.run(CALM[20:], sides=2, start=20)
    master.slave.setFMUState(kept)
    assert same(master.run(CALM[20:], sides=2, start=20), first)
    master.slave.freeFMUState(kept)
    other = Master(archive, name="other").initialise()
    other.slave.setFMUState(other.slave.deserializeFMUState(told))
    assert same(other.run(CALM[20:], sides=2, start=20), first)
    with pytest.raises(FMICallException):
        other.slave.deserializeFMUState(bytes(len(told)))
    assert "no" in other.said[-1][1] or "not a serialized state" in other.said[-1][1]


def test_leaving_the_table_is_an_error_with_words_and_no_clipping(archive):
    """The range ends 0.1 mm before the faces; without it, the mover runs out of the table's gaps."""
    master = Master(archive).initialise(travel=0.0)
    with pytest.raises(FMICallException):
        master.run(steps([9.0, 0.0]), sides=2)
    status, said = master.said[-1]
    assert status == ERROR
    assert re.search(r"left the table of force and flux linkage \(gap 0\.05 \.\.\. 1\.2 mm, current up to 12 A", said)
    assert re.search(r"after t = 0\.\d+ s, at i = .* x = 0\.0005\d+ m, x' = ", said)
    position, gap, force = master.get("position", "gap_1", "force_1")
    assert 5.3e-4 < position < 5.5e-4  # the last good state, finite, inside
    assert gap >= 5e-5
    assert np.isfinite(force)
    with pytest.raises(FMICallException):
        master.slave.doStep(1.0, 1 / RATE)
    assert "has failed; reset" in master.said[-1][1]
    master.slave.reset()
    master.initialise().run(CALM, sides=2)


def test_leaving_the_travel_is_an_error_with_words(archive):
    master = Master(archive).initialise()
    with pytest.raises(FMICallException):
        master.run(steps([6.0, 0.0]), sides=2)
    assert "the mover left its travel after t = " in master.said[-1][1]


@pytest.mark.parametrize(
    ("start", "said"),
    [
        ({"moving_mass": 0.0}, "moving_mass must be above 0 kg"),
        ({"moving_mass": float("nan")}, "a parameter is not a finite number"),
        ({"largest_step": -1.0}, "largest_step must be above 0 s"),
        ({"damping": -1.0}, "must not be negative"),
        ({"voltage_limit": -1.0}, "a limit of 0 stands for none"),
        ({"drive_bandwidth": -1.0}, "bandwidths must not be negative"),
        ({"end_stop_restitution": 1.5}, "between 0 and 1"),
        ({"position_start": 6e-4}, "position_start lies outside the travel"),
        ({"current_2_start": 13.0}, "the start lies outside the table of force and flux linkage: gap 0.05"),
        ({"end_stop": True, "travel": 6e-4}, "nominal_gap must be positive and above the travel to an end stop"),
    ],
)  # fmt: skip
def test_a_start_that_cannot_be_is_refused_in_words(archive, start, said):
    master = Master(archive)
    with pytest.raises(FMICallException):
        master.initialise(**start)
    assert said in master.said[-1][1]
    master.slave.reset()
    master.initialise()


def test_what_is_called_out_of_turn_is_refused_in_words(archive):
    master = Master(archive)
    for call, said in (
        (
            lambda: master.slave.doStep(0.0, 1 / RATE),
            "fmi2DoStep cannot be called now: the instance is not initialised",
        ),
        (master.slave.exitInitializationMode, "fmi2ExitInitializationMode cannot be called now"),
        (lambda: master.put("position", 1.0), "an output cannot be set"),
        (lambda: master.slave.getReal([999]), "no Real with the value reference 999"),
        (lambda: master.slave.setInteger([0], [1]), "all Integers are outputs"),
        (lambda: master.slave.getString([0]), "no String with the value reference 0"),
    ):
        with pytest.raises(FMICallException):
            call()
        assert said in master.said[-1][1]
    master.initialise()
    for call, said in (
        (lambda: master.put("moving_mass", 1.0), "a parameter cannot be set once the simulation has begun"),
        (lambda: master.put("end_stop", True), "fmi2SetBoolean cannot be called now: the simulation has begun"),
        (lambda: master.slave.doStep(0.0, 0.0), "a communication step must be above 0 s"),
        (lambda: master.slave.doStep(0.0, float("nan")), "a communication step must be above 0 s"),
    ):
        with pytest.raises(FMICallException):
            call()
        assert said in master.said[-1][1]
    master.put("command_1", float("inf"))
    with pytest.raises(FMICallException):
        master.slave.doStep(0.0, 1 / RATE)
    assert "an input or the state is no finite number" in master.said[-1][1]


def test_a_foreign_guid_is_refused(archive, monkeypatch):
    said = []
    monkeypatch.setattr(Master, "_log", lambda self, *args: said.append(args[-1].decode()))
    with pytest.raises(Exception, match="Failed to instantiate"):
        Master(archive, guid="{0}")
    assert "the GUID is not that of this FMU" in said[0]


def test_the_note_tells_how_to_compile_it(archive, tmp_path):
    """The command in sources/build.txt, run as it stands, makes a library that steps alike."""
    compiler("gcc")
    wanted = Master(archive).initialise().run(CALM, sides=2)
    with zipfile.ZipFile(archive) as content:
        content.extractall(tmp_path / "x")
    folder = tmp_path / "x" / "sources"
    command = re.search(r"^For Linux: +(gcc .*)$", (folder / "build.txt").read_text(), flags=re.MULTILINE)
    subprocess.run(command.group(1).split(), cwd=folder, check=True)
    [library] = folder.glob("*.so")
    library.replace(tmp_path / "x" / "binaries" / "linux64" / library.name)
    again = tmp_path / "again.fmu"
    with zipfile.ZipFile(again, "w") as content:
        for path in (tmp_path / "x").rglob("*"):
            content.write(path, path.relative_to(tmp_path / "x"))
    assert same(Master(again).initialise().run(CALM, sides=2), wanted)


def test_the_same_model_gives_the_same_archive_and_another_one_another_guid(archive, servo, table, tmp_path):
    again, other = tmp_path / "again.fmu", tmp_path / "other.fmu"
    fmu.write(ModelSource(servo, table), again)
    assert again.read_bytes() == archive.read_bytes()
    fmu.write(ModelSource(servo.model_copy(update={"name": '<&">'}), table), other)
    guids = {Master(one).description.guid for one in (archive, other)}
    assert len(guids) == 2


def test_without_gcc_the_sources_are_there(servo, table, tmp_path, monkeypatch):
    monkeypatch.setattr(fmu_library.shutil, "which", lambda name: None)
    target = tmp_path / "m.fmu"
    fmu.write(ModelSource(servo, table), target)
    assert fmu.platforms(target) == []
    with zipfile.ZipFile(target) as content:
        assert {"sources/fmu_api.c", "sources/fmu_plant.c", "sources/build.txt"} <= set(content.namelist())


def test_a_compiler_that_refuses_leaves_no_archive(servo, table, tmp_path, monkeypatch):
    broken = tmp_path / "gcc"
    broken.write_text("#!/bin/sh\necho 'no room' >&2\nexit 1\n")
    broken.chmod(0o755)
    monkeypatch.setattr(fmu_library.shutil, "which", lambda name: str(broken))
    with pytest.raises(ComputationError, match="gcc could not compile the FMU: no room"):
        fmu.write(ModelSource(servo, table), tmp_path / "m.fmu")
    assert [path.name for path in tmp_path.iterdir()] == ["gcc"]


def test_magnets_need_a_table(servo):
    with pytest.raises(InputError, match="has magnets and there is no table"):
        fmu.fmu_files(ModelSource(servo, None))
