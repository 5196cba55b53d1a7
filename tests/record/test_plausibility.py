"""Records against what machines show: units that are wrong by powers of ten, sensors that are not connected."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import saturating_reluctance
from small_record import RATE, columns
from test_measured_table import NOISE, scattered

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.errors import ActuatorError, InputError, RecordError
from msl_fem.identification.model import fit_percent
from msl_fem.record.measured_table import table_from_measurements
from msl_fem.record.plausibility import doubtful_against_command
from msl_fem.record.reader import check_run
from msl_fem.record.record import Run, Sampling
from msl_fem.record.static_file import read_static_map

FILE = Path("r/noise.csv")


def with_command() -> dict[str, np.ndarray]:
    """A good run with the commands that its currents follow."""
    table = columns()
    for side in (1, 2):
        table[f"command_{side}_A"] = table[f"current_{side}_A"] * 1.1 + 0.01
    return table


def doubts(table: dict[str, np.ndarray]) -> list[str]:
    return doubtful_against_command(Run("noise", "noise", "fit", table), file=FILE)


def test_a_good_run_raises_no_doubt() -> None:
    assert doubts(with_command()) == []
    assert doubts(columns()) == []


def test_a_dead_current_sensor_is_told_by_the_command() -> None:
    table = with_command()
    table["command_2_A"][:] = 0.3
    table["current_2_A"][:] = 0.0
    [said] = doubts(table)
    assert "current_2_A stands at 0 A throughout while 0.3 A are commanded" in said
    table["current_2_A"][:] = 0.3
    assert doubts(table) == [], "a standing command may be followed"


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_a_current_in_another_unit_is_told_by_the_command(factor: float) -> None:
    table = with_command()
    table["current_1_A"] = table["current_1_A"] * factor
    [said] = doubts(table)
    assert "is one of them in another unit?" in said


@pytest.mark.parametrize(("name", "factor"), [("command_1_A", 1e15), ("voltage_2_V", 1e9), ("current_1_A", 1e8)])
def test_what_no_machine_shows_is_refused(servo: Actuator, name: str, factor: float) -> None:
    table = with_command()
    table[name] = table[name] * factor
    with pytest.raises(RecordError, match=f"column {name}: .* is more than any machine shows"):
        check_run(Run("noise", "noise", "fit", table), servo, Sampling(rate=RATE), file=FILE)


@pytest.mark.parametrize(
    ("name", "value"), [("gap_m", 1e3), ("current_A", -1e9), ("force_N", 1e12), ("flux_linkage_Wb", 1e9)]
)
def test_a_static_map_that_no_machine_shows_is_refused(name: str, value: float) -> None:
    names = ("gap_m", "current_A", "force_N", "flux_linkage_Wb")
    rows = {column: np.array([1e-3, 2e-3]) for column in names}
    read_static_map(rows, role="fit", file="static.csv")
    rows[name][1] = value
    with pytest.raises(RecordError, match=rf"static\.csv: row 3 .*column {name}: .* is more than any machine shows"):
        read_static_map(rows, role="fit", file="static.csv")


@pytest.mark.filterwarnings("error")
def test_a_current_of_next_to_nothing_says_nothing_of_the_inductance() -> None:
    static = scattered(saturating_reluctance)
    force_alone = replace(static, flux_linkage=None)
    current = static.current.copy()
    current[np.argmin(np.where(current > 0, current, np.inf))] = 1e-320
    table_from_measurements(replace(force_alone, current=current), NOISE)


def test_the_fit_of_a_standing_output_is_no_number() -> None:
    assert np.isnan(fit_percent(np.full(50, 1e-4), np.zeros(50)))


@pytest.mark.parametrize(("column", "factor"), [("flux_linkage", 1e6), ("gap", 1e-3), ("force", 1e3), ("force", -1.0)])
def test_force_and_flux_that_contradict_each_other_are_refused(column: str, factor: float) -> None:
    """Force is -dW/dg of the coenergy whose dW/di is the flux linkage; no fit may hide that it is not."""
    static = scattered(saturating_reluctance)
    with pytest.raises((InputError, ArithmeticError, RuntimeError)) as refused:
        table_from_measurements(replace(static, **{column: getattr(static, column) * factor}), NOISE)
    assert "contradict each other" in str(refused.value) or "falls below 0" in str(refused.value)


def test_an_outlier_is_named_by_its_row() -> None:
    static = scattered(saturating_reluctance)
    notes = table_from_measurements(static, NOISE)[1].notes
    assert not any("sigma off the fit" in note for note in notes)
    flux = static.flux_linkage.copy()
    flux[37] = 0.0
    notes = table_from_measurements(replace(static, flux_linkage=flux), NOISE)[1].notes
    [said] = [note for note in notes if "flux_linkage_Wb" in note and "sigma off the fit" in note]
    assert "static.csv row 39 (" in said.partition(",")[2][:40], said


ABSURD = {
    "current_sensor": {"noise": "1e9 A"},
    "position_sensor": {"resolution": "100 km"},
    "drive": {"kind": "force", "bandwidth": "1e-9 Hz"},
    "motion": {"moving_mass": "1e15 kg"},
}


@pytest.mark.parametrize("section", ABSURD)
def test_numbers_that_no_machine_has_are_refused(section: str) -> None:
    content = {"schema": 1, "name": "rig", "motion": {"moving_mass": "1 kg"}, "drive": {"kind": "force"}}
    parse_actuator(content)
    with pytest.raises(ActuatorError, match=section):
        parse_actuator(content | {section: ABSURD[section]})


def test_leaves_as_wide_as_the_earth_are_refused() -> None:
    leaf = {"length": "30 mm", "width": "25000 km", "thickness": "0.3 mm", "count": 4, "material": "spring steel"}
    with pytest.raises(ActuatorError, match=r"motion\.flexure\.width.*out of range"):
        parse_actuator({"schema": 1, "name": "rig", "motion": {"moving_mass": "1 kg", "flexure": leaf}})
