"""Tables for other tools: CSV that reads back, C that evaluates the coenergy surface to the last bit."""

import csv
import dataclasses
from importlib import import_module

import numpy as np
import pytest
from c_programs import READ_AND_WRITE, VARIANTS, any_doubles, assert_same_bits, compile_c, run_pairs
from conftest import closed_form_table

from msl_fem.errors import InputError
from msl_fem.export import table_formats
from msl_fem.export.c_table import table_check_points, table_header
from msl_fem.export.formats import FORMATS, find_format
from msl_fem.maps import operating_map
from msl_fem.table.coenergy_surface import evaluate_slopes
from msl_fem.table.magnetic_table import NODES

JUDGE = """
enum { n_out = 12 };
static int self_check(void) { return m_table_self_check(); }
static void judge(double current, double gap, double out[n_out])
{
    const int inside = m_table_evaluate(current, gap, out);
    out[9] = inside == m_table_slopes(current, gap, out + 6) ? m_table_force(current, gap) : -1.0;
    out[10] = m_table_flux_linkage(current, gap);
    out[11] = m_table_inductance(current, gap);
}
"""
SOURCE = READ_AND_WRITE.replace("/* doubles", JUDGE + "/* doubles")


@pytest.mark.parametrize("variant", VARIANTS)
def test_c_evaluates_the_surface_as_python_does(table, tmp_path, variant):
    (tmp_path / "exported.h").write_text(table_header(table, name="m"))
    program = compile_c(tmp_path, SOURCE, variant)
    rng, n = np.random.default_rng(12), 100_000
    current, gap = rng.uniform(-12.2, 12.2, n), rng.uniform(4.9e-5, 1.21e-3, n)
    current[::9], gap[::8] = (
        rng.choice(np.r_[-table.current, table.current], current[::9].size),
        rng.choice(table.gap, gap[::8].size),
    )
    current[::50], gap[::60] = any_doubles(rng, current[::50].size), any_doubles(rng, gap[::60].size)
    fixed = table_check_points(table)
    current[: fixed[0].size], gap[: fixed[1].size] = fixed
    found, wanted = run_pairs(program, current, gap, 12), table.surface(current, gap).T
    assert 0.02 < np.isnan(wanted[:, 0]).mean() < 0.1
    assert_same_bits(found[:, :6], wanted)
    assert_same_bits(found[:, 9:], wanted[:, [2, 1, 3]])
    s = table.surface
    slopes = [
        evaluate_slopes(s.gap, s.current, s.coefficients, i, g)[1:]
        for i, g in zip(current[:5000], gap[:5000], strict=True)
    ]
    assert_same_bits(found[:5000, 6:9], np.array(slopes))


def test_the_header_says_where_it_comes_from():
    known = dataclasses.replace(
        closed_form_table(n_gap=3, n_current=4),
        provenance={"actuator": "*/x", "actuator_sha256": "ab12"},
        mesh_error=1e-4,
    )
    header = table_header(known)
    comment = header.split("*/")[0]
    for said in ("actuator:            __x", "ab12", "mesh error:          0.0001", "5e-05 m to 0.0012 m", "12 A"):
        assert said in comment
    assert "x_table_force(" in header


def test_a_table_reads_back_from_csv_to_the_last_digit(table, tmp_path):
    (file,) = table_formats.write_csv(table, tmp_path / "t.csv")
    with file.open(newline="") as stream:
        rows = list(csv.reader(stream))
    assert rows[0] == [
        "gap_m", "current_A", "force_N", "flux_linkage_Wb", "coenergy_J", "incremental_inductance_H",
        "force_current_slope_N_per_A", "force_gap_slope_N_per_m", "flux_density_centre_leg_T", "flux_density_yoke_T",
    ]  # fmt: skip
    values = np.array(rows[1:], dtype=float).reshape(table.gap.size, table.current.size, -1)
    np.testing.assert_array_equal(values[:, 0, 0], table.gap)
    np.testing.assert_array_equal(values[0, :, 1], table.current)
    assert (values[:, :, 0] == table.gap[:, None]).all()
    assert (values[:, :, 1] == table.current).all()
    for name in NODES:
        (column,) = [
            k
            for k, text in enumerate(rows[0])
            if text.startswith(f"{name}_") and "slope" not in text.removeprefix(name)
        ]
        np.testing.assert_array_equal(values[:, :, column], table.nodes[name])
    np.testing.assert_array_equal(values[:, :, 8], table.extras["flux_density_centre_leg"])
    assert b"\r" not in file.read_bytes()


def test_every_entry_has_a_writer(table, tmp_path):
    records = {"table": table, "map": operating_map(table)}
    for entry in FORMATS:
        module, _, function = entry.writer.partition(":")
        assert callable(getattr(import_module(module), function))
    for entry in (e for e in FORMATS if e.needs in records):  # models and controllers have tests of their own
        target = tmp_path / (f"{entry.to}.m" if entry.to == "simulink" else f"{entry.to}.{entry.what}")
        assert target in entry.write(records[entry.needs], target)
        assert target.stat().st_size > 1000
    with pytest.raises(InputError, match="--name is the beginning of C names"):
        find_format("csv", "table", "table").write(table, tmp_path / "x", name="x")
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("to", "what", "source", "found"),
    [("c", None, "map", "guard"), ("c", None, "table", "table"), ("c", "guard", "table", "guard"),
     ("c", "guard", "actuator", "guard"), ("csv", None, "actuator", "table")],
)  # fmt: skip
def test_without_what_the_source_itself_is_meant(to, what, source, found):
    assert find_format(to, what, source).what == found


@pytest.mark.parametrize(
    ("to", "what", "source", "said"),
    [("xml", None, "map", "--to xml is not available; there is c, csv"),
     ("c", "soul", "map", "--what soul is not available as c; there is guard, table"),
     ("csv", None, "map", "--to csv --what table needs a file with table or actuator; this is one with a map"),
     ("c", "table", "map", "needs a file with table or actuator")],
)  # fmt: skip
def test_what_cannot_be_exported_is_said(to, what, source, said):
    with pytest.raises(InputError, match=said):
        find_format(to, what, source)
