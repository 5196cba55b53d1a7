"""Properties of what files hold, on drawn contents: what is written reads back, what is read obeys its own rules."""

import dataclasses
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from msl_fem.actuator import Actuator, load_actuator, parse_actuator
from msl_fem.design.sizing.requirement import load_requirement, parse_requirement
from msl_fem.errors import InputError, OutOfTable
from msl_fem.files.quantity import parse_quantity
from msl_fem.files.schema import document
from msl_fem.files.toml_text import quantity_text, toml_text
from msl_fem.maps import Guard, OperatingMap, read_map, write_map
from msl_fem.maps.map_file import map_from_json, map_to_json
from msl_fem.plant.effects import CATALOGUE, EffectValues
from msl_fem.plant.extended_model import ExtendedModel, load_extended_model, write_extended_model
from msl_fem.record import Record, Run, Sampling, load_record, write_record
from msl_fem.table.magnetic_table import MagneticTable, read_table, write_table

ROOT = Path(__file__).parent.parent.parent
SERVO = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml")
REQUIREMENT = load_requirement(ROOT / "requirements" / "400_newton.toml")
FEW = settings(max_examples=40, deadline=None)
FACTOR = st.floats(-0.5, 0.5).map(lambda power: 10.0**power)


def or_none(make: Callable[[], Any]) -> Any:
    """What is made, or None where it is refused as a user's mistake."""
    try:
        return make()
    except InputError:
        return None


def quantities(content: Any, at: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """Key paths of the texts of a document that are quantities."""
    if isinstance(content, dict):
        return [path for key, value in content.items() for path in quantities(value, (*at, key))]
    is_one = isinstance(content, str) and content[:1].isdigit() and " " in content and "sources" not in at
    return [at] if is_one else []


def stretched(content: dict[str, Any], factors: dict[tuple[str, ...], float]) -> dict[str, Any]:
    """A copy of a document whose quantities at these key paths are larger by these factors."""
    copy = {key: stretched(value, {}) if isinstance(value, dict) else value for key, value in content.items()}
    for path, factor in factors.items():
        section = copy
        for key in path[:-1]:
            section = section[key]
        number, unit = section[path[-1]].split(" ", 1)
        section[path[-1]] = quantity_text(parse_quantity(f"{float(number) * factor!r} {unit}", unit), unit)
    return copy


def factors_of(content: dict[str, Any]) -> st.SearchStrategy[dict[tuple[str, ...], float]]:
    return st.dictionaries(st.sampled_from(quantities(content)), FACTOR, max_size=4)


@FEW
@given(factors=factors_of(document(SERVO)))
def test_an_actuator_reads_back_as_it_was_written(factors: dict[tuple[str, ...], float]) -> None:
    """Whatever its numbers, either it is refused in one line that names a key, or its file gives the same actuator."""
    content = stretched(document(SERVO), factors)
    actuator = or_none(lambda: parse_actuator(content, file=SERVO.file))
    assume(actuator is not None)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.toml"
        path.write_text(toml_text(document(actuator)), encoding="utf-8")
        again = load_actuator(path)
    assert again.digest == actuator.digest
    assert document(again) == document(actuator)


@FEW
@given(factors=factors_of(document(REQUIREMENT)))
def test_a_requirement_reads_back_as_it_was_written(factors: dict[tuple[str, ...], float]) -> None:
    content = stretched(document(REQUIREMENT), factors)
    requirement = or_none(lambda: parse_requirement(content))
    assume(requirement is not None)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.toml"
        path.write_text(toml_text(document(requirement)), encoding="utf-8")
        assert load_requirement(path).digest == requirement.digest


PARAMETERS = [(effect, parameter) for effect, entry in CATALOGUE.items() for parameter in entry.parameters]


@st.composite
def effect_values(draw: st.DrawFn) -> EffectValues:
    """Any parameters of any effects, within their bounds and not beyond a thousand times their usual size."""
    chosen = draw(st.lists(st.sampled_from(range(len(PARAMETERS))), unique=True, max_size=6))
    stated: dict[str, dict[str, float]] = {}
    for n in chosen:
        effect, p = PARAMETERS[n]
        low, high = max(p.bounds[0], -1e3 * p.scale), min(p.bounds[1], 1e3 * p.scale)
        stated.setdefault(effect, {})[p.name] = draw(st.floats(low, high))
    return EffectValues(stated)


@FEW
@given(effects=effect_values())
def test_an_extended_model_reads_back_as_it_was_written(effects: EffectValues) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "extended_model.toml"
        write_extended_model(ExtendedModel(SERVO, effects), path)
        again = load_extended_model(path)
    assert again.actuator.digest == SERVO.digest
    np.testing.assert_allclose(again.effects.vector(), effects.vector(), rtol=5e-16, atol=0)
    assert again.effects.present == effects.present


@pytest.mark.parametrize("end", [0, 1])
def test_effects_at_their_bounds_read_back(end: int, tmp_path: Path) -> None:
    """A text with a prefix may round across a bound; then the file says the number itself."""
    stated: dict[str, dict[str, float]] = {}
    for effect, p in PARAMETERS:
        if np.isfinite(p.bounds[end]):
            stated.setdefault(effect, {})[p.name] = p.bounds[end]
    effects = EffectValues(stated)
    again = load_extended_model(write_extended_model(ExtendedModel(SERVO, effects), tmp_path / "e.toml"))
    np.testing.assert_allclose(again.effects.vector(), effects.vector(), rtol=5e-16, atol=0)


@FEW
@given(n=st.sampled_from(range(len(PARAMETERS))), beyond=st.floats(1e-6, 1e6), above=st.booleans())
def test_an_effect_beyond_its_bounds_is_refused(n: int, beyond: float, above: bool) -> None:
    effect, p = PARAMETERS[n]
    bound = p.allowed[1] if above else p.allowed[0]
    assume(np.isfinite(bound))
    value = bound + (1 if above else -1) * beyond * p.scale
    assume(value != bound)
    with pytest.raises(InputError, match=p.name):
        EffectValues({effect: {p.name: value}})


@st.composite
def tables(draw: st.DrawFn) -> MagneticTable:
    """Linear magnets W' = L(g) i^2/2, L = a/(g + b), of any size, on any grids."""
    gaps = np.cumsum(draw(st.lists(st.floats(1e-5, 1e-3), min_size=2, max_size=7)))
    currents = np.cumsum([0.0, *draw(st.lists(st.floats(0.05, 5.0), min_size=2, max_size=6))])
    a, b = draw(st.floats(1e-7, 1e-3)), draw(st.floats(1e-6, 1e-3))
    i, g = np.meshgrid(currents, gaps)
    inductance, slope, bend = a / (g + b), -a / (g + b) ** 2, 2 * a / (g + b) ** 3
    nodes = {
        "coenergy": inductance * i**2 / 2, "flux_linkage": inductance * i, "force": -slope * i**2 / 2,
        "incremental_inductance": inductance, "force_current_slope": -slope * i, "force_gap_slope": -bend * i**2 / 2,
    }  # fmt: skip
    text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
    said = draw(st.dictionaries(text, text | st.floats(allow_nan=False) | st.booleans(), max_size=3))
    return MagneticTable(gaps, currents, nodes, mesh_error=draw(st.floats(0, 1)), provenance=said)


@settings(max_examples=12, deadline=None)
@given(table=tables(), share=st.tuples(st.floats(0, 1), st.floats(0.01, 1)))
def test_a_table_reads_back_and_obeys_its_rules(table: MagneticTable, share: tuple[float, float]) -> None:
    """The same bits from the file; nodes are taken; reciprocity by differences; nothing beyond the rectangle."""
    with tempfile.TemporaryDirectory() as folder:
        again = read_table(write_table(table, Path(folder) / "t.nc"))
    assert dict(again.provenance) == dict(table.provenance)
    assert again.mesh_error == table.mesh_error
    for name, values in table.nodes.items():
        np.testing.assert_array_equal(again.nodes[name], values)
    at_nodes = again.evaluate(*np.meshgrid(table.current, table.gap))
    for name in ("coenergy", "flux_linkage", "force", "force_current_slope"):
        scale = np.abs(table.nodes[name]).max()
        np.testing.assert_allclose(at_nodes[name], table.nodes[name], rtol=0, atol=1e-9 * scale)
    gap = table.gap[0] + share[0] * (table.gap[-1] - table.gap[0])
    current = share[1] * table.current[-1]
    found = again.evaluate([current, -current], gap)
    np.testing.assert_array_equal(found["force"][0], found["force"][1])
    np.testing.assert_array_equal(found["flux_linkage"][0], -found["flux_linkage"][1])
    for outside in ((np.nextafter(table.current[-1], np.inf), gap), (current, np.nextafter(table.gap[0], 0))):
        with pytest.raises(OutOfTable):
            again.evaluate(*outside)


@st.composite
def maps(draw: st.DrawFn) -> OperatingMap:
    """Maps of one to three levels over two to eight gaps; some points not reached."""
    n_gap, n_level = draw(st.integers(2, 8)), draw(st.integers(1, 3))
    gap = np.cumsum(draw(st.lists(st.floats(1e-5, 1e-3), min_size=n_gap, max_size=n_gap)))
    first = np.array(draw(st.lists(st.floats(0.1, 10.0), min_size=n_gap, max_size=n_gap)))
    current = first * np.cumsum(np.ones(n_level))[:, None]
    most = float(draw(st.floats(0.5, 50.0)))
    current = np.where(current <= most, current, np.nan)
    text = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
    return OperatingMap(
        levels=1.0 + 0.2 * np.arange(n_level), gap=gap, current=current,
        section=tuple(("centre_leg",) * n_gap for _ in range(n_level)), error=np.zeros((n_level, n_gap)),
        allowance=np.full((n_level, n_gap), draw(st.floats(0, 0.05))), current_max=most, criterion="mean",
        actuator=draw(text), digest=draw(text), warnings=tuple(draw(st.lists(text, max_size=2))),
    )  # fmt: skip


@FEW
@given(operating_map=maps(), share=st.floats(0, 1), amps=st.floats(0, 60))
def test_a_map_reads_back_and_its_guard_is_never_milder(operating_map: OperatingMap, share: float, amps: float) -> None:
    """The file gives the same map; a guard allows no current beyond the chord of the map's points."""
    with tempfile.TemporaryDirectory() as folder:
        again = read_map(write_map(operating_map, Path(folder) / "m.json"))
    for field in dataclasses.fields(OperatingMap):
        mine, theirs = getattr(operating_map, field.name), getattr(again, field.name)
        if isinstance(mine, np.ndarray):
            np.testing.assert_array_equal(mine, theirs, err_msg=field.name)
        else:
            assert mine == theirs, field.name
    assert map_to_json(map_from_json(map_to_json(again))) == map_to_json(again)
    gap = operating_map.gap[0] + share * (operating_map.gap[-1] - operating_map.gap[0])
    last = np.nan_to_num(operating_map.current[-1], nan=operating_map.current_max)
    allowed = np.interp(gap, operating_map.gap, last)
    if amps > allowed * (1 + 1e-12):
        assert Guard(again).classify(amps, gap) == "unacceptable"


@st.composite
def records(draw: st.DrawFn) -> Record:
    """Records of the reference actuator with any plausible signals."""
    rng, n, rate = np.random.default_rng(draw(st.integers(0, 2**32))), 1000 + draw(st.integers(0, 50)), 1e4
    scale = {"voltage_1_V": 50.0, "voltage_2_V": 50.0, "current_1_A": 10.0, "current_2_A": 10.0, "position_m": 2e-4}
    columns = {"time_s": np.arange(n) / rate}
    for name, size in scale.items():
        columns[name] = size * draw(st.floats(-1, 1)) + size * draw(st.floats(0, 0.5)) * rng.standard_normal(n) / 4
    word = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), max_size=30)
    kind = draw(st.sampled_from(["csv", "nc"]))
    runs = (Run(name="a", excitation=draw(word), role="fit", columns=columns, file_format=kind),)
    return Record(origin="measured", actuator=SERVO, sampling=Sampling(rate=rate), runs=runs)


@settings(max_examples=15, deadline=None)
@given(record=records())
def test_a_record_reads_back_as_it_was_written(record: Record) -> None:
    """NetCDF to the last bit, CSV to nine digits, and words to the last character."""
    with tempfile.TemporaryDirectory() as folder:
        assume(or_none(lambda: [write_record(record, Path(folder) / "rec")]))
        again = load_record(Path(folder) / "rec")
    run, read = record.runs[0], again.runs[0]
    assert read.excitation == run.excitation
    assert isinstance(again.actuator, Actuator)
    for name, values in run.columns.items():
        within = 0.0 if run.file_format == "nc" else 5e-9
        np.testing.assert_allclose(read.columns[name], values, rtol=within, atol=0, err_msg=name)
