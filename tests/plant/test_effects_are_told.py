"""Every effect of the catalogue is taken, or declined with a reason, wherever its physics is told.

A part that claims a parameter must change with it, one that declines must not: so nobody is offered an effect that
silently does nothing.
"""

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import ROOT, closed_form_table
from coupled_twin import changed
from effect_sets import rig

from msl_fem.actuator import Actuator, load_actuator
from msl_fem.control import design_model_with_effects
from msl_fem.diagnosis.carriages import offered
from msl_fem.diagnosis.inverse_force import ZeroPhaseLowPass, missing_force
from msl_fem.diagnosis.static_maps import StaticLikelihood, prepared_map
from msl_fem.diagnosis.unknowns import Unknowns
from msl_fem.diagnosis.variants import RecordFeatures, possible, variants
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.plant import plant_parameters, surface_of
from msl_fem.plant.effects import CATALOGUE, Effect, EffectValues, Parameter, kernel_coefficients
from msl_fem.plant.effects.entry import Part
from msl_fem.plant.instruments import instruments_of
from msl_fem.plant.preparation import small_signal_inductance
from msl_fem.prediction import RunData
from msl_fem.record import Noise, Record, Sampling, StaticMap

TABLE = closed_form_table()
SERVO = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
DOCUMENTED = (ROOT / "docs" / "coupled_model.md").read_text(encoding="utf-8")
TOY = Effect(
    name="air_drag",
    group="mechanical",
    sentence="drag of the air",
    equation="force -drag v |v|",
    source="Lord Rayleigh, Philosophical Magazine 2, 1876, 430-441",
    parameters=(Parameter("drag", "", 0.0, (0.0, 1e4), 1.0, "of the force over the velocity squared"),),
    design=Part(("drag",)),
    inverse=Part(("drag",)),
    static=Part(("drag",)),
    advice="",
)


def amounts(effect: Effect) -> Iterator[tuple[str, EffectValues]]:
    """Each amount with the values in which it alone is there, at its scale."""
    for name in effect.amounts:
        yield name, EffectValues({effect.name: {name: effect.parameter(name).scale}})


def in_the_kernel(values: EffectValues) -> tuple[np.ndarray, ...]:
    """The numbers with which kernel and instruments act."""
    plant, surface = plant_parameters(SERVO), surface_of(TABLE)
    inductance = small_signal_inductance(plant, surface)
    rows = kernel_coefficients(plant, values.vector(), inductance=inductance, step=1e-5, n_step=10)
    read = instruments_of(values.vector(), rate=1e4)
    return (rows, read.delay, read.polynomial, read.drift, read.hum)


def in_the_inverse(values: EffectValues) -> tuple[np.ndarray, ...]:
    """The force that the motion of a rig takes."""
    rate, time = 1000.0, np.arange(2000) / 1000.0
    position = 1e-3 * np.sin(2 * np.pi * 3 * time) + 2e-4 * np.sin(2 * np.pi * 7 * time)
    commands = np.column_stack([np.cos(2 * np.pi * 5 * time), np.zeros(time.size)])
    data = RunData("run", "fit", rate, commands, {"position_m": position}, {})
    plant = plant_parameters(changed(rig(), drive={"bandwidth": 100.0}))._replace(stiffness=0.0)
    low_pass = ZeroPhaseLowPass(20.0, rate)
    return (missing_force(plant, data, values.vector(), gain=1.0, low_pass=low_pass),)


@cache
def map_at_rest() -> tuple[StaticLikelihood, Unknowns]:
    """The likelihood of force and flux of a magnet, measured point after point."""
    gap, current = (a.ravel() for a in np.meshgrid([2e-4, 4e-4, 7e-4], [0.5, 2.0, 5.0, 1.0]))
    rows = StaticMap(gap, current, np.ones(gap.size), np.ones(gap.size), np.full(gap.size, "fit"))
    noise = Noise(position=1e-9, force=0.1, flux_linkage=1e-5)
    record = Record("simulated", SERVO, sampling=Sampling(rate=1e4), noise=noise, static=rows, runs=())
    return prepared_map(record, TABLE)


def at_rest(values: EffectValues) -> tuple[np.ndarray, ...]:
    """What a measured map misses."""
    likelihood, unknowns = map_at_rest()
    return tuple(likelihood.missed(unknowns, np.zeros(unknowns.size), values.vector()).values())


@cache
def regions() -> OperatingMap:
    """The map of the table, the same for every effect."""
    return operating_map(TABLE, levels=(1.2, 1.6))


def in_the_design(values: EffectValues) -> tuple[object, ...]:
    """What a controller believes."""
    belief = design_model_with_effects(SERVO, TABLE, regions(), values)
    inverse = belief.inverse
    return (
        np.array([belief.cubic, belief.coupled.constant_force, inverse.gap_1, inverse.gap_2]),
        np.array([belief.plant.damping, belief.plant.lag, belief.plant.delay]),
        inverse.surface_1.coefficients,
        inverse.surface_1.current,
    )


PLACES = {"design": in_the_design, "inverse": in_the_inverse, "static": at_rest}


@cache
def neutral() -> dict[str, tuple]:
    """What each place has without effects."""
    return {name: place(EffectValues()) for name, place in PLACES.items()} | {"kernel": in_the_kernel(EffectValues())}


def differs(one: tuple, two: tuple) -> bool:
    return any(not np.array_equal(a, b) for a, b in zip(one, two, strict=True))


def complaints(effect: Effect) -> list[str]:
    """What is wrong with what an effect says of itself."""
    found = [] if effect.advice else ["words: no advice"]
    names = (effect.name, *(p.name for p in effect.parameters))
    found += [f"documentation: {name}" for name in names if not re.search(rf"\b{name}\b", DOCUMENTED)]
    found += [
        f"kernel: {n}" for n, values in amounts(effect) if not differs(in_the_kernel(values), neutral()["kernel"])
    ]
    for place, numbers in PLACES.items():
        part: Part = getattr(effect, place)
        if set(part.parameters) != set(effect.amounts) and not part.declined:
            found.append(f"{place}: no reason")
        if ". " in part.declined:
            found.append(f"{place}: more than one sentence")
        for name, values in amounts(effect):
            if differs(numbers(values), neutral()[place]) != (name in part.parameters):
                found.append(f"{place}: {name} is {'claimed' if name in part.parameters else 'declined'}")
    return found


@pytest.mark.parametrize("name", CATALOGUE)
def test_an_effect_is_taken_or_declined_everywhere(name: str) -> None:
    assert complaints(CATALOGUE[name]) == []


def test_a_new_effect_is_missed_where_it_is_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CATALOGUE, TOY.name, TOY)
    places = {complaint.split(":")[0] for complaint in complaints(TOY)}
    assert places == {"kernel", "design", "inverse", "static", "words", "documentation"}
    silent = replace(TOY, design=Part(), inverse=Part(), static=Part())
    assert {c for c in complaints(silent) if "no reason" in c} == {f"{place}: no reason" for place in PLACES}


def test_a_rig_is_offered_nothing_that_does_nothing() -> None:
    """A slew limit, an error of the drive's bandwidth and a relaxing spring were offered to a carriage."""
    carriage: Actuator = changed(rig(), drive={"bandwidth": 100.0}, motion={"stiffness": 0.0})
    plant, scene = plant_parameters(carriage), RecordFeatures(1e-3, 1.0, 1e-2, 5.0)
    told = {(v.effect, a.name) for v in offered(plant, scene) for a in v.amounts}
    all_of_them = {(v.effect, a.name) for e in possible(plant) for v in variants(e, scene, plant) for a in v.amounts}
    assert told == {(effect, name) for effect, name in all_of_them if name in CATALOGUE[effect].inverse.parameters}
    assert ("amplifier_bandwidth", "slew_time") in all_of_them - told
    assert ("flexure_relaxation", "strength") in all_of_them - told
