"""The library of a formula's terms: units that come out, ranges that suit a record, and a record's laws joined."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosed import SERVO, VOLTAGE_SERVO

from msl_fem.computing.laws import UNIT_OF, expression
from msl_fem.diagnosis import formula, formula_search
from msl_fem.diagnosis.formula_terms import LARGEST, LawSizes, amount_unit, library
from msl_fem.diagnosis.refits import Refit
from msl_fem.diagnosis.variants import Variant
from msl_fem.plant import plant_parameters


def _sizes():
    chance = np.random.default_rng(4)
    values = {name: chance.normal(size=500) for name in ("x", "v", "i", "i1", "i2")}
    values |= {name: 1 + 0.1 * chance.uniform(size=500) for name in ("g", "g1", "g2")}
    return LawSizes(values, {"force": 20.0, "voltage": 3.0, "position_reading": 1e-3})


@pytest.mark.parametrize("sides", [1, 2])
@pytest.mark.parametrize("actuator", [SERVO, VOLTAGE_SERVO], ids=["current", "voltage"])
def test_every_term_is_a_law_with_its_unit_and_range(actuator, sides):
    """Built without an error its units are right; the widest amount makes a term `LARGEST` times its equation's."""
    plant = plant_parameters(actuator)._replace(sides=sides)
    laws = library(plant, _sizes())
    assert {law.equation for law in laws} == set(UNIT_OF)
    assert len({(law.equation, law.text) for law in laws}) == len(laws) > 50
    assert all(len(law.parameters) <= 2 for law in laws)
    assert ("i2" in {name for law in laws for name in law.law.names}) == (sides == 2)
    cube = next(law for law in laws if law.text == "a*v**3")
    rms = np.sqrt(np.mean(_sizes().variables["v"] ** 6))
    assert cube.parameters[0].high * rms == pytest.approx(LARGEST * 20.0)


def test_units_of_amounts():
    assert amount_unit("force", (0, 2, 0)) == "N s2/m2"
    assert amount_unit("voltage", (-1, 0, 2)) == "V m/A2"
    assert amount_unit("position_reading", (1, 1, 0)) == "m s/m2"


def test_a_constant_of_a_law_reads_back():
    """What is stated alone stays a constant in a file."""
    law = expression("root", "force", "-a*sqrt(abs(v)/w)", {"a": "0..9 N", "w": "0.5 m/s"})
    again = expression("root", "force", law.text, {p.name: p.text for p in law.bare.parameters})
    assert again.bare == law.bare
    assert again.parameters[1].low == again.parameters[1].high == 0.5


@pytest.mark.parametrize(
    ("alone", "left", "beside", "taken"),
    [
        (103.0, 1.0, 100.0, "alone"),
        (97.0, 1.0, 100.0, "beside"),
        (103.0, 1.2, 100.0, "beside"),
        (103.0, 1.0, None, None),
        (113.0, 1.0, None, "alone"),
    ],
)
def test_one_term_takes_the_place_of_a_named_effect_that_is_superfluous_beside_it(
    monkeypatch: pytest.MonkeyPatch, alone: float, left: float, beside: float | None, taken: str | None
) -> None:
    """The evidence of a term alone and its residuals, of the effect with one beside it (None: none stands there; the
    effect has 100 then), and what is told. A term alone is asked for what it has to bring."""

    def chosen(start: Any, *, tell: Any, most: int = 3, least: float = 12.0) -> Any:
        if start.of == "nothing":
            assert (most, least) == (1, (112.0 if beside is None else beside) - 40.0)
            return SimpleNamespace(of="alone", fit=SimpleNamespace(log_evidence=alone, excess={"force_N": left}))
        return None if beside is None else SimpleNamespace(of="beside", fit=SimpleNamespace(log_evidence=beside))

    monkeypatch.setattr(formula, "chosen_terms", chosen)
    monkeypatch.setattr(formula, "_told", lambda kind, found, alone: found.of)
    starts: Any = [SimpleNamespace(of="nothing", log_evidence=40.0), SimpleNamespace(of="effect", log_evidence=100.0)]
    assert formula.formula_of(None, starts, tell=str) == taken  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("gain", "predicted", "left", "first", "hopeless"),
    [
        (8.0, 0.0, 1.0, True, True),
        (8.0, 5.0, 1.0, True, False),
        (40.0, 0.0, 2.0, True, False),
        (40.0, 0.0, 2.7, True, True),
        (40.0, 20.0, 2.7, True, False),
        (40.0, 0.0, 2.7, False, True),
        (40.0, 20.0, 2.7, False, True),
        (40.0, 0.0, 1.5, False, False),
    ],
)
def test_a_term_is_led_to_its_end_where_it_may_be_worth_it(
    gain: float, predicted: float, left: float, first: bool, hopeless: bool
) -> None:
    """Nats that the next step promises bring it to the nats or to the share of the excess that a term takes: a first
    one 30 %, a further one 75 %."""
    before: Any = SimpleNamespace(excess={"force_N": 3.0})
    fit: Any = SimpleNamespace(excess={"force_N": left}, predicted=predicted, stuck=False)
    fit.to_come = lambda steps: predicted
    law = expression("root", "force", "-a*v", {"a": "0..9 N s/m"})
    refit = Refit(Variant("root", ()), fit, gain)
    assert formula_search._hopeless(before, () if first else (law,), 12.0, refit) is hopeless
