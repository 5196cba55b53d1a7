"""A bias on both sides, believed by the table of a pair: forces by two routes, and what it changes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import ROOT
from servo_controllers import servo

from msl_fem.control import DesignModel, design_model_of
from msl_fem.control.baselines import _forces, bias_point
from msl_fem.errors import InputError
from msl_fem.maps import operating_map
from msl_fem.plant.operating_point import net_force
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import load_table


@cache
def pair() -> MagneticTable:
    return load_table(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc")


@cache
def belief(*, both: bool = True) -> DesignModel:
    table = pair() if both else replace(pair(), shared=None)
    return design_model_of(servo(), table, operating_map(pair(), levels=(1.2, 1.6)))


@pytest.mark.parametrize(("control", "position"), [(0.4, 1e-4), (-0.7, -2e-4), (2.5, 0.0)])
def test_force_about_a_bias_is_that_of_the_plant(control: float, position: float) -> None:
    """Its slopes by differences; beyond the bias one side is off."""
    model, bias = belief(), 2.0

    def force(d: float, x: float) -> float:
        currents = max(bias + d, 0.0), max(bias - d, 0.0)
        whole = float(net_force(model.coupled, pair(), currents=currents, position=np.array(x))[0])
        return whole + model.coupled.stiffness * x

    found = _forces(model, bias, control, position)
    assert found[0] == pytest.approx(force(control, position), rel=1e-12)
    h = 1e-5
    slope = (force(control + h, position) - force(control - h, position)) / (2 * h)
    assert found[1] == pytest.approx(slope, rel=1e-6)
    stiffness = (force(control, position + 1e-8) - force(control, position - 1e-8)) / 2e-8
    assert found[2] == pytest.approx(stiffness, rel=1e-5)


def test_a_saturated_armature_changes_the_stiffness() -> None:
    """By less than 0.1 % at 0.5 A on both sides, by more than 1 % at 3 A, whose fluxes add up in the armature."""
    changes = []
    for bias in (0.5, 3.0):
        together, apart = bias_point(belief(), bias, 2e-4), bias_point(belief(both=False), bias, 2e-4)
        assert together is not None
        assert apart is not None
        changes.append(together.magnet_stiffness / apart.magnet_stiffness - 1)
    assert abs(changes[0]) < 0.001
    assert changes[1] == pytest.approx(-0.012, abs=0.003)


def test_a_table_of_another_pair_is_refused() -> None:
    wide = servo(motion={"nominal_gap": 6.2e-4})
    with pytest.raises(InputError, match=r"gaps are 1.2 mm together, the actuator's are 1.24 mm"):
        design_model_of(wide, pair(), operating_map(pair(), levels=(1.2, 1.6)))
