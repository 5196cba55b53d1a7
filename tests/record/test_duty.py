"""A drive that is known by its duty gives the record that its voltages would."""

import numpy as np
import pytest
from small_record import RIG, columns, make

from msl_fem.errors import RecordError
from msl_fem.record import load_record

SUPPLY = RIG.replace("[sampling]", '[supply]\nvoltage = "24 V"\n[sampling]')


def with_duty(**spoilt):
    table = columns()
    for side in (1, 2):
        table[f"duty_{side}"] = table.pop(f"voltage_{side}_V") / 24
    return table | spoilt


def test_duties_are_voltages_of_the_supply(tmp_path) -> None:
    plain = load_record(make(tmp_path / "plain"))
    duty = load_record(make(tmp_path / "duty", rig=SUPPLY, noise=with_duty()))
    for side in (1, 2):
        np.testing.assert_allclose(duty.run("noise")[f"voltage_{side}_V"], plain.run("noise")[f"voltage_{side}_V"])
    assert not duty.run("noise").extra


@pytest.mark.parametrize(
    ("rig", "table", "told"),
    [
        (RIG, with_duty(), r"state \[supply\] voltage"),
        (SUPPLY, with_duty(duty_1=50 * np.ones(1000)), "is it in per cent"),
        (SUPPLY, columns() | {"duty_1": np.zeros(1000)}, "state the same"),
        (SUPPLY.replace("24 V", "0 V"), with_duty(), "supply.voltage"),
    ],
)
def test_duties_that_say_no_voltage_are_refused(tmp_path, rig, table, told) -> None:
    with pytest.raises(RecordError, match=told):
        load_record(make(tmp_path / "duty", rig=rig, noise=table))
