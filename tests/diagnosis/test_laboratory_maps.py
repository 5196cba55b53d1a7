"""Static maps of laboratories: noise of each row, repeats, unknown order and history, no scale, several units."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from msl_fem.actuator import load_actuator
from msl_fem.design.tolerances.manufactured import tolerances_of
from msl_fem.diagnosis import DiagnosisSettings, diagnose
from msl_fem.diagnosis.measured_map import knows_its_past, measured_map, noise_of, path_of
from msl_fem.diagnosis.static_maps import map_alone
from msl_fem.errors import InputError, RecordError
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.static_map import static_map
from msl_fem.prediction import ModelHypothesis
from msl_fem.record import Noise, Record, StaticMap, load_record, write_record
from msl_fem.table.magnetic_table import read_table

ROOT = Path(__file__).parents[2]
NOISE = Noise(force=0.02, flux_linkage=2e-5)


@pytest.fixture(scope="module")
def table():
    return read_table(ROOT / "lookup_tables" / "fast_tool_servo.nc")


@pytest.fixture(scope="module")
def believed(table):
    """(model, surface, plant) of the servo's magnet."""
    actuator = load_actuator(ROOT / "geometries" / "fast_tool_servo.toml").model_copy(update={"drive": None})
    rows = StaticMap(np.full(3, 6e-4), np.array([0.5, 1.0, 1.5]), np.ones(3), None, np.full(3, "fit"))
    kind = map_alone(Record("measured", actuator, noise=NOISE, static=rows), ModelHypothesis(actuator, table))
    plant = kind.likelihood.problem.plant
    return actuator, plant.surface, plant.parameters


def loops(believed, effects, rng, *, before=()):
    """Two loops of current at three gaps each, as measured; `before` are currents that the iron went through."""
    _, surface, plant = believed
    one = np.concatenate([np.linspace(0.1, 3, 9), np.linspace(2.7, 0.1, 8)])
    gap = np.repeat([5e-4, 6e-4, 7e-4], 2 * one.size)
    current, number = np.tile(one, 6), np.repeat(np.arange(6.0), one.size)
    first = np.flatnonzero(np.r_[True, np.diff(number) != 0])
    at = np.repeat(first, len(before))
    path = [np.insert(gap, at, gap[at]), np.insert(current, at, np.tile(before, first.size))]
    kept = np.insert(np.ones(gap.size, bool), at, False)
    force, flux = static_map(
        surface, plant, effects, gap=path[0], current=path[1], sequence=np.insert(number, at, number[at])
    )
    force = force[kept] + NOISE.force * rng.normal(size=gap.size)
    flux = flux[kept] + NOISE.flux_linkage * rng.normal(size=gap.size)
    role = np.where(number % 2 == 1, "held-out", "fit")
    return StaticMap(gap, current, force, flux, role, sequence=number)


def record_of(believed, static, noise=NOISE):
    return Record("measured", believed[0], noise=noise, static=static)


def diagnosed(believed, table, static, noise=NOISE):
    return diagnose(record_of(believed, static, noise), DiagnosisSettings(table=table))


HYSTERESIS = EffectValues({"magnetic_hysteresis": {"coercive_current": 0.05}})


def test_the_cycles_before_the_rows_are_gone_through(believed, table) -> None:
    """Rows of an iron that was cycled are hit where the cycles are stated and missed where they are not."""
    static = loops(believed, HYSTERESIS, np.random.default_rng(3), before=(3.5, -3.5, 3.5))
    left = {}
    for before in ("cycled:+3.5 A", "cycled:-3.5 A", "demagnetised"):
        record = record_of(believed, replace(static, before=before))
        rows = map_alone(record, ModelHypothesis(believed[0], table)).rows
        path = path_of(record.static)
        force, _ = static_map(believed[1], believed[2], HYSTERESIS, gap=path.gap, current=path.current,
                              sequence=path.sequence)  # fmt: skip
        missed = rows.measured.channels["force_N"] - force[path.rows]
        left[before] = float(np.sqrt(np.mean(missed**2)) / NOISE.force)
    assert left["cycled:+3.5 A"] < 1.2
    assert min(left["cycled:-3.5 A"], left["demagnetised"]) > 2
    with pytest.raises(InputError, match="leave the table"):
        measured_map(record_of(believed, replace(static, before="cycled:+90 A")), table)


def test_an_unknown_history_counts_what_lies_behind_the_largest_current(believed) -> None:
    static = replace(loops(believed, EffectValues(), np.random.default_rng(1)), before="unknown")
    known = knows_its_past(static).reshape(6, -1)
    assert not known[:, :8].any()
    assert known[:, 8:].all()
    assert knows_its_past(replace(static, before="demagnetised")).all()


def test_no_loop_is_read_from_an_unknown_order(believed, table) -> None:
    """Rows sorted by current: as measured they would be hysteresis; of unknown order nothing tries it."""
    static = loops(believed, HYSTERESIS, np.random.default_rng(4))
    assert diagnosed(believed, table, static).names == ("magnetic_hysteresis",)
    found = diagnosed(believed, table, replace(static, order="unknown"))
    assert "magnetic_hysteresis" not in {tried.effect for tried in found.evidence.tried}
    assert found.names == ()


def test_each_row_has_the_noise_of_its_column(believed, table) -> None:
    """A fifth of the rows is twenty times as noisy: said, it hides nothing and names nothing; unsaid, it is excess."""
    rng = np.random.default_rng(5)
    static = loops(believed, HYSTERESIS, rng)
    sigma = np.where(rng.random(static.gap.size) < 0.2, 20.0, 1.0) * NOISE.force
    rough = replace(static, force=static.force + np.sqrt(sigma**2 - NOISE.force**2) * rng.normal(size=sigma.size))
    said = diagnosed(believed, table, replace(rough, sigma={"force_N": sigma}))
    assert (said.verdict, said.names) == ("named", ("magnetic_hysteresis",))
    assert diagnosed(believed, table, rough).verdict != "named"


def test_the_noise_is_taken_from_repeats(believed) -> None:
    """Where none is stated: within its standard error of 10 %; neighbours would see the loops' own shape."""
    static = loops(believed, EffectValues(), np.random.default_rng(6))
    twice = static.at(np.repeat(np.arange(static.gap.size), 2))
    twice = replace(twice, force=twice.force + 0.5 * np.random.default_rng(7).normal(size=twice.gap.size))
    assert noise_of(record_of(believed, twice, Noise()), "force_N")[0] == pytest.approx(0.5, rel=0.2)


def test_readings_without_a_scale_tell_by_their_shape(believed, table) -> None:
    """A field probe in gauss times anything, and a force in divisions: the coercive current is found all the same."""
    static = loops(believed, HYSTERESIS, np.random.default_rng(11))
    free = replace(static, force=7.3 * static.force, flux_linkage=None, flux_density=41 * static.flux_linkage)
    free = replace(free, sigma={"force_N": np.full(free.gap.size, 7.3 * NOISE.force),
                                "flux_density_T": np.full(free.gap.size, 41 * NOISE.flux_linkage)})  # fmt: skip
    found = diagnosed(believed, table, replace(free, scale="free"))
    assert found.names == ("magnetic_hysteresis",)
    coercive = found.causes[0].parameters["coercive_current"]
    assert coercive.low < 0.05 < coercive.high
    assert diagnosed(believed, table, free).verdict != "named"


def test_the_statements_are_written_and_read_again(believed, tmp_path) -> None:
    static = loops(believed, EffectValues(), np.random.default_rng(8))
    unit = np.where(np.arange(static.gap.size) % 2 == 1, "A", "B")
    sigma = {"force_N": np.full(static.gap.size, 0.03)}
    stated = replace(static, unit=unit, sigma=sigma, order="unknown", before="cycled:+3.5 A", scale="free",
                     flux_density=30 * static.flux_linkage)  # fmt: skip
    write_record(record_of(believed, stated), tmp_path / "lab")
    again = load_record(tmp_path / "lab").static
    assert (again.order, again.before, again.scale) == ("unknown", "cycled:+3.5 A", "free")
    assert again.unit.tolist() == unit.tolist()
    np.testing.assert_allclose(again.sigma["force_N"], 0.03)
    np.testing.assert_allclose(again.flux_density, stated.flux_density, rtol=1e-8)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ('before = "cycled"', "is no history"),
        ('before = "cycled:10"', "unit"),
        ('order = "sorted"', "measured"),
        ('scale = "relative"', "stated"),
    ],
)
def test_statements_that_are_none_are_refused(believed, tmp_path, line, told) -> None:
    write_record(record_of(believed, loops(believed, EffectValues(), np.random.default_rng(8))), tmp_path / "lab")
    rig = tmp_path / "lab" / "rig.toml"
    rig.write_text(rig.read_text().replace('gap = "gauge"', f'gap = "gauge"\n{line}'))
    with pytest.raises(RecordError, match=told):
        load_record(tmp_path / "lab")


def test_units_scatter_beside_their_common_cause(believed, table) -> None:
    """Four magnets by the drawing's limits: what each has of its own is found, what all have is named."""
    actuator, surface, plant = believed
    rng = np.random.default_rng(21)
    gaps, sizes = rng.uniform(-20e-6, 20e-6, 4), rng.uniform(-0.02, 0.02, 4)
    parts = []
    for n in range(4):
        rows = loops(believed, EffectValues(), rng)
        force, flux = static_map(surface, plant, HYSTERESIS, gap=rows.gap + gaps[n], current=rows.current,
                                 sequence=rows.sequence)  # fmt: skip
        noise = rng.normal(size=(2, force.size))
        parts.append((rows, (1 + sizes[n]) * force + NOISE.force * noise[0],
                      (1 + sizes[n]) * flux + NOISE.flux_linkage * noise[1]))  # fmt: skip
    names = ("gap", "current", "role", "sequence")
    together = {name: np.concatenate([getattr(p[0], name) for p in parts]) for name in names}
    static = StaticMap(**together, force=np.concatenate([p[1] for p in parts]),
                       flux_linkage=np.concatenate([p[2] for p in parts]),
                       unit=np.repeat([f"no. {n}" for n in range(4)], parts[0][0].gap.size))  # fmt: skip
    scatter = measured_map(record_of(believed, static), table).scatter
    np.testing.assert_allclose(scatter.gap, gaps - gaps.mean(), atol=1e-6)
    np.testing.assert_allclose(scatter.scale, sizes - sizes.mean(), atol=2e-3)
    limits = {t.name: t for t in tolerances_of(actuator)}
    assert scatter.foretold_gap == pytest.approx(20e-6 / np.sqrt(3))
    assert scatter.foretold_scale > limits["stack_depth"].limit / limits["stack_depth"].nominal / np.sqrt(3)
    found = diagnosed(believed, table, static)
    assert found.names == ("magnetic_hysteresis",)
    assert any("4 units scatter by" in note and "manufacturing limits foretell 11.5 um" in note for note in found.notes)
    assert diagnosed(believed, table, replace(static, unit=None)).verdict != "named"


def test_interleaved_units_have_histories_of_their_own(believed) -> None:
    static = loops(believed, EffectValues(), np.random.default_rng(2))
    order = np.argsort(np.r_[np.arange(static.gap.size), np.arange(static.gap.size) + 0.5])
    both = static.at(np.r_[np.arange(static.gap.size), np.arange(static.gap.size)][order])
    both = replace(both, unit=np.tile(["A", "B"], static.gap.size))
    path = path_of(both)
    np.testing.assert_array_equal(path.current[path.rows], both.current)
    np.testing.assert_array_equal(path.current, np.tile(static.current, 2))
    assert np.count_nonzero(np.diff(path.sequence)) == 11


def short(believed, effects, rng, count=10):
    """A map of a few rows over gap and current, none held out."""
    _, surface, plant = believed
    gap, current = rng.uniform(4e-4, 8e-4, count), rng.uniform(0.5, 6.0, count)
    force, flux = static_map(surface, plant, effects, gap=gap, current=current, sequence=np.arange(count))
    force = force + NOISE.force * rng.normal(size=count)
    return StaticMap(gap, current, force, flux + NOISE.flux_linkage * rng.normal(size=count), np.full(count, "fit"))


def test_ten_rows_are_held_out_in_turn(believed, table) -> None:
    """A stack that is deeper is named by each turn; clean rows name nothing; a cause of two rows alone neither."""
    deeper = short(believed, EffectValues({"fringing": {"depth_error": 0.08}}), np.random.default_rng(1))
    found = diagnosed(believed, table, deeper)
    assert found.names == ("fringing",)
    assert any("in one of 4 turns" in note for note in found.notes)
    clean = short(believed, EffectValues(), np.random.default_rng(2))
    assert diagnosed(believed, table, clean).verdict == "nothing-found"
    bent = replace(clean, force=clean.force * np.where(np.arange(10) < 2, 1.1, 1.0))
    assert diagnosed(believed, table, bent).verdict != "named"


def test_seven_rows_are_too_few(believed, table) -> None:
    found = diagnosed(believed, table, short(believed, EffectValues(), np.random.default_rng(2), count=7))
    assert (found.verdict, "at least 12" in found.reason) == ("undecidable", True)


@pytest.mark.parametrize(("offset", "names"), [(4e-6, ()), (6e-5, ("gap_offset",))])
def test_a_wrong_zero_of_the_gauges_is_named_beyond_their_tolerance(believed, table, offset, names) -> None:
    """2 um are their tolerance; what lies beyond was called hysteresis and fringing."""
    static = loops(believed, EffectValues({"gap_offset": {"offset": offset}}), np.random.default_rng(1))
    assert diagnosed(believed, table, static).names == names
