"""The Modelica text, read by a reader as strict as the documentation of CombiTable2D, and interpolated as it does."""

import re

import numpy as np
import pytest
from conftest import closed_form_table

from msl_fem.export import table_formats
from msl_fem.export.table_formats import refined_grid
from msl_fem.table.magnetic_table import MagneticTable

NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")


def read_tables(text: str) -> dict[str, np.ndarray]:
    """The matrices of a text file of the Modelica Standard Library's tables.

    "#1" are the first two characters, alone on their line; a header "double name(rows,columns)" stands before each
    matrix; numbers in C's syntax are parted by blanks, tabs, commas or semicolons, in order of rows, and a row may go
    on over several lines; what follows "#" on a line is a comment. Anything else is an error.
    """
    assert text.isascii()
    first, *lines = text.split("\n")
    assert first == "#1"
    tables: dict[str, np.ndarray] = {}
    name, shape, numbers = "", (0, 0), []

    def finish() -> None:
        if name:
            assert name not in tables
            tables[name] = np.array(numbers, dtype=float).reshape(shape)  # raises where elements are missing

    for line in lines:
        content = line.split("#")[0].strip(" \t,;")
        if header := re.fullmatch(r"(double|float)\s+([A-Za-z_]\w*)\s*\((\d+),\s*(\d+)\)", content):
            finish()
            name, shape, numbers = header[2], (int(header[3]), int(header[4])), []
        else:
            for word in re.split(r"[ \t,;]+", content) if content else []:
                assert NUMBER.fullmatch(word), word
                numbers.append(float(word))
    finish()
    return tables


def bilinear(table: np.ndarray, u1: float, u2: float) -> float:
    """CombiTable2D with Smoothness.LinearSegments: u1 along the first column, u2 along the first row."""
    rows, columns, values = table[1:, 0], table[0, 1:], table[1:, 1:]
    assert (np.diff(rows) > 0).all()
    assert (np.diff(columns) > 0).all()
    assert rows[0] <= u1 <= rows[-1]
    assert columns[0] <= u2 <= columns[-1]
    m = min(int(np.searchsorted(rows, u1, side="right")) - 1, rows.size - 2)
    n = min(int(np.searchsorted(columns, u2, side="right")) - 1, columns.size - 2)
    s, t = (u1 - rows[m]) / (rows[m + 1] - rows[m]), (u2 - columns[n]) / (columns[n + 1] - columns[n])
    between = values[m] * (1 - s) + values[m + 1] * s
    return float(between[n] * (1 - t) + between[n + 1] * t)


@pytest.fixture(scope="module")
def tables(table, tmp_path_factory):
    target = tmp_path_factory.mktemp("modelica") / "t.txt"
    assert table_formats.write_modelica(table, target) == (target,)
    return read_tables(target.read_text(encoding="ascii"))


def test_the_reader_knows_the_documented_example():
    """The example of CombiTable2D's documentation: u1 = 1, u2 = 1 gives 1; u1 = 2, u2 = 1.5 gives 3."""
    text = "#1\n# a comment\ndouble table2D_1(3,4) # another\n0, 1 2\t3;\n1 1 3 5\n2 2\n4 6\n"
    found = read_tables(text)["table2D_1"]
    assert bilinear(found, 1.0, 1.0) == 1.0
    assert bilinear(found, 2.0, 1.5) == 3.0
    for wrong in (text[1:], text.replace("4 6", "4"), text.replace("double", "int"), text.replace("0,", "nan")):
        with pytest.raises((AssertionError, ValueError)):
            read_tables(wrong)


def test_the_nodes_come_back_with_the_current_first(tables, table):
    assert list(tables) == list(table_formats.MATRICES)
    for name in tables:
        found = tables[name]
        assert found.shape == (2 * 76 + 2, 78)
        assert found[0, 0] == 0.0
        np.testing.assert_array_equal(found[0, 1::4], table.gap)
        np.testing.assert_array_equal(found[77::4, 0], table.current)
        within = 1e-4 if name == "incremental_inductance" else 1e-11  # the surface takes that one at its edges alone
        scale = np.abs(table.nodes[name]).max()
        np.testing.assert_allclose(found[77::4, 1::4].T, table.nodes[name], rtol=0, atol=within * scale)


def test_negative_currents_follow_from_symmetry(tables, table):
    for i in (-7.3, -0.2, 3.1):
        for g in (6e-5, 4.4e-4, 1.1e-3):
            exact = table.evaluate(i, g)
            for name in tables:
                scale = np.abs(table.nodes[name]).max()
                assert bilinear(tables[name], i, g) == pytest.approx(float(exact[name]), abs=1e-2 * scale), name
    assert bilinear(tables["flux_linkage"], -3.0, 5e-4) < 0 < bilinear(tables["force"], -3.0, 5e-4)


def test_the_stated_error_of_linear_interpolation_is_the_real_one(tables, table):
    """Random points err by no more than what the header says, and some by half of it."""
    said = re.search(r"errs by up to (\S+) of the largest", table_formats.modelica_text(table))
    stated, rng = float(said[1]), np.random.default_rng(5)
    i, g = rng.uniform(0, 12, 20_000), rng.uniform(5e-5, 1.2e-3, 20_000)
    worst = 0.0
    for name in ("force", "flux_linkage"):
        exact, scale = table.evaluate(i, g)[name], np.abs(table.nodes[name]).max()
        found = [bilinear(tables[name], *at) for at in zip(i[:4000], g[:4000], strict=True)]
        worst = max(worst, float(np.abs(np.array(found) - exact[:4000]).max() / scale))
    assert 0.3 * stated < worst < 1.5 * stated


def test_four_parts_err_sixteen_times_less():
    """Bilinear interpolation is of second order."""
    table = closed_form_table(n_gap=12, n_current=12)
    coarse, fine = (refined_grid(table, parts=n).linear_error["force"] for n in (4, 8))
    assert coarse / fine == pytest.approx(4.0, abs=0.4)


def test_foreign_texts_stay_comments(table):
    hostile = MagneticTable(
        table.gap,
        table.current,
        table.nodes,
        provenance={"actuator": "a\ndouble x(1,1)\n666", "actuator_sha256": "#é"},
    )
    text = table_formats.modelica_text(hostile)
    assert "\n666" not in text
    assert read_tables(text)["force"].shape == (154, 78)
