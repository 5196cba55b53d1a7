"""A requirement file is read with units, its defaults are stated, and what is wrong with it is one clear line."""

from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from sizing_requirements import SERVO, requirement

from msl_fem.design.sizing import load_requirement, parse_requirement
from msl_fem.errors import InputError, RequirementError


def test_example_is_read_in_si() -> None:
    it = load_requirement(ROOT / "requirements" / "400_newton.toml")
    assert (it.force.minimum, it.force.gap, it.flux.limit) == (400.0, 0.5e-3, 1.2)
    assert it.heat.largest_current_density == 5e6
    assert it.objectives == ("mass", "loss")
    assert it.folder == ROOT / "requirements"


def test_defaults() -> None:
    it = requirement(heat={})
    assert it.heat.largest_current_density == 5e6, "without any limit of heat"
    assert requirement(heat={"temperature_rise": "60 K"}).heat.largest_current_density is None
    assert (it.flux.limit, it.flux.criterion) == (1.2, "mean")
    assert it.nominal_gap == it.force.gap
    assert it.range == pytest.approx(0.4e-3)
    assert it.objectives == ("mass", "loss")


def test_supply_is_per_side() -> None:
    """Two magnets in series share the voltage, two in parallel the current."""
    supply = {"voltage": "80 V", "current": "12 A"}
    series = requirement(supply=supply, sides={"count": 2, "magnets_per_side": 2})
    assert (series.coil_voltage, series.coil_current) == (40.0, 12.0)
    parallel = requirement(supply=supply, sides={"count": 2, "magnets_per_side": 2, "connection": "parallel"})
    assert (parallel.coil_voltage, parallel.coil_current) == (80.0, 6.0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"force": {"minimum": "150 N"}}, "force.gap: is missing"),
        ({"force": {"minimum": "150 V", "gap": "0.5 mm"}}, "force.minimum: unit 'V' has the wrong dimension"),
        ({"force": {"minimum": 150, "gap": "0.5 mm"}}, "force.minimum: 150 has no unit"),
        ({"force": {"minimum": "-1 N", "gap": "0.5 mm"}}, "force.minimum: Input should be greater than 0"),
        ({"force": {"minimum": "1 N", "gap": "0.5 mm", "slew": "1 N/s"}}, "force.slew: unknown key"),
        ({"force": {"minimum": "1 N", "gap": "20 m"}}, "force.gap 20 m is above 10 m"),
        ({"flux": {"limit": "12 T"}}, "flux.limit: Input should be less than or equal to 3"),
        ({"flux": {"criterion": "max"}}, "flux.criterion: Input should be 'mean'"),
        ({"heat": {"current_density": "5 A/mm"}}, "heat.current_density: unit 'A/mm' has the wrong dimension"),
        ({"objectives": ["mass", "price"]}, "objectives.1: Input should be 'mass', 'loss', 'force' or 'inductance'"),
        ({"objectives": ["mass", "mass"]}, "objectives names one twice"),
        ({"objectives": []}, "objectives: Tuple should have at least 1 item"),
        ({"motion": {"nominal_gap": "0.5 mm", "range": "0.6 mm"}}, "motion.range 600 µm must be below"),
        ({"motion": {"nominal_gap": "2 mm", "range": "1 mm"}}, "force.gap 500 µm lies outside the motion's gaps"),
        ({"winding": {"fill_factor": 1.5}}, "winding.fill_factor: Input should be less than 1"),
        ({"bogus": 1}, "bogus: unknown key"),
        ({"file": "x"}, "file: unknown key"),
    ],
)
def test_what_is_wrong_is_one_line(change: dict[str, Any], said: str) -> None:
    with pytest.raises(RequirementError) as caught:
        parse_requirement({**SERVO, **change})
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(RequirementError, match=r"none\.toml: cannot be read"):
        load_requirement(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("schema = ")
    with pytest.raises(RequirementError, match="not valid TOML"):
        load_requirement(tmp_path / "bad.toml")
    assert issubclass(RequirementError, InputError)


def test_digest_is_that_of_the_content(tmp_path: Path) -> None:
    text = (ROOT / "requirements" / "400_newton.toml").read_text()
    (tmp_path / "same.toml").write_text("# another comment\n" + text)
    (tmp_path / "other.toml").write_text(text.replace('"400 N"', '"401 N"'))
    known = load_requirement(ROOT / "requirements" / "400_newton.toml").digest
    assert load_requirement(tmp_path / "same.toml").digest == known
    assert load_requirement(tmp_path / "other.toml").digest != known
