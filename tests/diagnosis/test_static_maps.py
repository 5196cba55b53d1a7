"""Static maps diagnosed: what is hidden on the bench, whose physics is its own, is named; clean maps name nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import load_actuator
from msl_fem.bench import BenchOptions, parse_requests, sealed_record
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.problem import Points
from msl_fem.diagnosis.static_maps import OF_THE_CURRENT, map_alone, prepared_map
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import parse_excitation
from msl_fem.plant.static_map import static_map
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Tolerance
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parents[2]
SHORT = tuple(
    parse_excitation(f"{kind},duration=0.6 s,bias=1.2 V", unit="V")
    for kind in (
        "band-limited-noise:amplitude=600 mV,band=500 Hz,seed=1,role=fit",
        "swept-sine:amplitude=300 mV,start=5 Hz,stop=300 Hz,role=held-out",
    )
)


@pytest.fixture(scope="module")
def table():
    return read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")


@pytest.fixture(scope="module")
def made(table):
    """(record of the map alone, what was hidden)"""
    whole = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
    actuator = whole.model_copy(update={"drive": whole.drive.model_copy(update={"kind": "voltage", "bandwidth": None})})

    def sealed(hide, seed):
        options = BenchOptions(seed=seed, static=True, excitations=SHORT)
        found = sealed_record(actuator, table, parse_requests([hide] if hide else []), options)
        return replace(found.record, runs=(), sampling=None), found.answer["effects"]

    return sealed


@pytest.mark.parametrize("hide", ["gap_offset=3%", "magnetic_hysteresis=3%", "fringing=3%"])
def test_what_was_hidden_is_named(made, table, hide):
    """Held-out rows end near the instruments' noise, where the refitted table does not, or a tolerance is left."""
    record, hidden = made(hide, 6)
    found = diagnose(record, DiagnosisSettings(table=table))
    assert found.names == (hide.split("=")[0],)
    assert all(a.prediction == "static" for a in found.accuracy)
    held = [a for a in found.accuracy if a.extended.role == "held-out"]
    assert {a.extended.channel for a in held} == {"force_N", "flux_linkage_Wb"}
    assert max(a.extended.rms / a.extended.floor for a in held) < 1.7
    assert min(a.nominal.rms / a.nominal.floor for a in held) > 3
    if hide.startswith("gap_offset"):
        offset = found.causes[0].parameters["offset"]
        assert offset.low < hidden[0]["parameters"]["offset"] < offset.high


@pytest.mark.parametrize("seed", [6, 7, 8])
def test_a_clean_map_names_nothing(made, table, seed):
    record, _ = made(None, seed)
    found = diagnose(record, DiagnosisSettings(table=table))
    assert (found.verdict, found.names) == ("nothing-found", ())
    assert max(a.refitted.rms / a.refitted.floor for a in found.accuracy) < 1.3


def test_tolerances_that_are_ignored_name_a_clean_map(made, table):
    """The same clean map under a belief without tolerances: something is named, which is what they guard against."""
    record, _ = made(None, 6)
    instruments = ("current_gain", "current_zero", "force_gain", "force_zero", "leakage_inductance")
    exact = Tolerance(nominal_gap=1e-6, magnetic_scale=1e-6, table=1e-6, **dict.fromkeys(instruments, 0.0))
    found = diagnose(replace(record, tolerance=exact), DiagnosisSettings(table=table))
    assert found.verdict != "nothing-found"


def test_the_extended_model_gives_the_map(made, table):
    """By a second route, the coupled model's static map on the extended table, the measured rows come out."""
    record, _ = made("magnetic_hysteresis=3%", 6)
    rows = record.static
    model = diagnose(record, DiagnosisSettings(table=table)).extended
    likelihood = map_alone(record, ModelHypothesis(record.actuator, model.table)).likelihood
    plant = likelihood.problem.plant
    gap = float(model.actuator.motion.nominal_gap) - float(record.actuator.motion.nominal_gap)
    force, _ = static_map(
        plant.surface, plant.parameters, model.effects or EffectValues(), gap=rows.gap + gap, current=rows.current,
        sequence=rows.sequence,
    )  # fmt: skip
    assert np.std(force - rows.force) < 1.3 * record.noise.force


def test_residuals_vanish_where_the_model_is_true(made, table):
    """A map made by the model itself, without noise, is hit to rounding; one wider by a micrometre is not."""
    record, _ = made(None, 6)
    likelihood, unknowns = prepared_map(record, table)
    plant, rows = likelihood.problem.plant, record.static
    for wider, hit in ((0.0, True), (1e-6, False)):
        force, flux = static_map(
            plant.surface, plant.parameters, EffectValues(), gap=rows.gap + wider, current=rows.current
        )
        true = replace(record, static=replace(rows, force=force, flux_linkage=flux))
        likelihood, unknowns = prepared_map(true, table)
        residual = likelihood.spectra(Points.of(unknowns, np.zeros((1, unknowns.size))))[0]
        assert (np.abs(residual).max() < 1e-9) == hit


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        (lambda s: replace(s, role=np.where(np.arange(s.gap.size) < 9, "fit", "held-out")), "at least 12"),
        (lambda s: replace(s, role=np.full(s.gap.size, "fit")), "held out"),
        (lambda s: replace(s, current=np.full(s.gap.size, 1.0)), "differ in gap alone"),
    ],
)
def test_a_map_that_cannot_decide(made, table, spoil, told):
    record, _ = made(None, 6)
    found = diagnose(replace(record, static=spoil(record.static)), DiagnosisSettings(table=table))
    assert found.verdict == "undecidable"
    assert told in found.reason
    assert found.names == ()


def test_hysteresis_is_named_by_a_map_at_one_gap_without_a_drive(made, table):
    """What gap and scale would explain cannot be tried there; what the current's history does can."""
    record, _ = made("magnetic_hysteresis=3%", 6)
    rows = record.static
    gaps, counts = np.unique(rows.gap, return_counts=True)
    at = np.flatnonzero(rows.gap == gaps[np.argmax(counts)])
    parts = {
        name: values[at]
        for name in ("gap", "current", "force", "flux_linkage", "role", "direction", "sequence")
        if (values := getattr(rows, name)) is not None
    }
    parts["role"] = np.where(np.arange(at.size) % 3 == 1, "held-out", "fit")
    actuator = record.actuator.model_copy(update={"drive": None})
    one = replace(record, static=replace(rows, **parts, extra={}), actuator=actuator)
    found = diagnose(one, DiagnosisSettings(table=table))
    assert found.names == ("magnetic_hysteresis",)
    assert {tried.effect for tried in found.evidence.tried} <= set(OF_THE_CURRENT)
