"""Runs that are tried first on a solenoid: a voltage step with the mover locked, and a pull-in against the end stop."""

import re
from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import Actuator
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant import refused_unless_borne
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.simulate import Options
from msl_fem.table.magnetic_table import MagneticTable

STEP = parse_excitation("step:channel=common,amplitude=0.5 V,duration=0.3 s", unit="V")


def lifter(servo: Actuator, *, end_stop: float | None = None) -> Actuator:
    """The servo's first side alone, on a voltage drive, without a spring: nothing holds its mover."""
    motion = servo.motion.model_copy(
        update={"stiffness": 0.0, "constant_force": -8.8, "end_stop": end_stop, "range": 5e-4}
    )
    sides = servo.sides.model_copy(update={"count": 1})
    drive = servo.drive.model_copy(update={"kind": "voltage", "bandwidth": None, "current_limit": None})
    return servo.model_copy(update={"motion": motion, "sides": sides, "drive": drive})


def test_a_locked_mover_shows_resistance_and_inductance(servo: Actuator, table: MagneticTable) -> None:
    """i tends to V/R of the side; at the step its rate is V/L of the side at the gap where the mover is held."""
    actuator, at = lifter(servo), 1e-4
    run = refused_unless_borne(actuator, table, STEP, rate=1e4, options=Options(position=at, locked=True))
    magnets = actuator.sides.magnets_per_side
    resistance = magnets * actuator.coil_resistance()
    assert (run.position == at).all()
    assert run.current[-1, 0] == pytest.approx(0.5 / resistance, rel=1e-4)
    k = int(np.flatnonzero(run.time >= 0.03)[0])
    inductance = magnets * float(table.evaluate(0.0, servo.motion.nominal_gap - at)["incremental_inductance"])
    assert run.current[k + 1, 0] == pytest.approx(0.5 / inductance * 1e-4, rel=0.01)
    assert abs(run.audit.mechanical) < 1e-15


def test_what_nothing_holds_is_refused_with_a_way_out(servo: Actuator, table: MagneticTable) -> None:
    with pytest.raises(
        InputError, match=r"nothing holds it; hold the mover \(simulate --locked\), state motion"
    ) as why:
        refused_unless_borne(lifter(servo), table, STEP, rate=1e4)
    assert "scale the currents by 0" not in str(why.value)
    assert "side 2" not in str(why.value)


def test_a_mover_with_an_end_stop_is_pulled_in_and_what_it_brings_is_lost_there(
    servo: Actuator, table: MagneticTable
) -> None:
    actuator = lifter(servo, end_stop=4e-4)
    step = parse_excitation("step:channel=common,amplitude=4 V,duration=0.12 s", unit="V")
    run = refused_unless_borne(actuator, table, step, rate=1e4, options=Options(position=-4e-4))
    assert (run.position[:120] == -4e-4).all(), "at rest on the lower stop before the step"
    assert run.position[-1] == 4e-4
    first = int(np.flatnonzero(run.position >= 4e-4)[0])
    speed = run.velocity[first - 1]
    assert run.audit.impact == pytest.approx(actuator.motion.moving_mass * speed**2 / 2, rel=0.1)
    assert run.audit.imbalance < 1e-3


def test_a_table_that_ends_before_the_stop_is_told_with_the_gaps(servo: Actuator, table: MagneticTable) -> None:
    """A mover that falls onto its lower stop: no advice on currents, and one current for one side."""
    short = lifter(servo, end_stop=float(table.gap[-1]) - servo.motion.nominal_gap + 2e-5)
    with pytest.raises(ComputationError, match=r"reach gaps of .* \.\.\. .*: make the table over them") as why:
        refused_unless_borne(short, table, STEP, rate=1e4)
    assert "RMS on all sides" not in str(why.value)
    assert re.search(r"at i = [^,]* A, x = ", str(why.value))


def test_all_that_is_wrong_with_an_excitation_and_its_keys_are_told() -> None:
    with pytest.raises(InputError, match=r"voltage and foo unknown, amplitude missing; step takes amplitude, duration"):
        parse_excitation("step:voltage=4 V,foo=2,duration=0.5 s")


def test_the_command_holds_the_mover(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from conftest import ROOT

    from msl_fem.cli.app import app
    from msl_fem.cli.output import run_guarded

    servo, table = ROOT / "geometries" / "fast_tool_servo.toml", ROOT / "lookup_tables" / "fast_tool_servo.nc"
    spec = "step:channel=1,amplitude=2 A,duration=0.1 s"
    options = ["--table", str(table), "--excitation", spec, "--locked", "--position", "0.2 mm"]
    written = tmp_path / "run"
    assert run_guarded(lambda: app(["simulate", str(servo), *options, "-o", str(written), "--json"])) == 0
    assert "mover locked at 0.2 mm" in (written / "rig.toml").read_text(encoding="utf-8")
