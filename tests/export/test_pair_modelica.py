"""The Modelica package of a pair's table: its functions, run from their text by an interpreter of its own, give the
table's force and flux linkages; what is written beside is what it says it reads."""

import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from scipy.io import loadmat

from msl_fem.table.pair_table import PAIR_NODES, PairTable, read_pair_table

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
PAIR = str(ROOT / "lookup_tables" / "fast_tool_servo_pair.nc")


class Matrix:
    """An array as Modelica has it: indices from 1, assigned by value."""

    def __init__(self, values: np.ndarray) -> None:
        self.values = np.array(values, dtype=float)

    def __getitem__(self, at: int | tuple[int, ...]) -> float:
        return float(self.values[self._place(at)])

    def __setitem__(self, at: int | tuple[int, ...], value: float) -> None:
        self.values[self._place(at)] = value

    def _place(self, at: int | tuple[int, ...]) -> tuple[int, ...]:
        places = tuple(k - 1 for k in (at if isinstance(at, tuple) else (at,)))
        assert all(isinstance(k, int) and 0 <= k < n for k, n in zip(places, self.values.shape, strict=True)), at
        return places


def check(holds: bool, message: str) -> None:
    if not holds:
        raise ValueError(message)


BUILT_IN: dict[str, Any] = {
    "abs": abs, "max": max, "div": lambda a, b: math.trunc(a / b), "mod": lambda a, b: a - math.floor(a / b) * b,
    "size": lambda a, k: a.values.shape[k - 1], "zeros": lambda n: Matrix(np.zeros(n)), "check": check,
}  # fmt: skip


def expression(text: str) -> str:
    """A Modelica expression in Python's words; what is none of its few words stays and fails there."""
    assert not re.search(r"\*\*|//|\[[^\]]*:", text), text
    text = re.sub(r"^if (.*) then (.*) else (.*)$", r"((\2) if (\1) else (\3))", text.strip())
    return text.replace("^", "**").replace("<>", "!=").replace("assert(", "check(")


def python_of(body: str) -> list[str]:
    """The lines of an algorithm section, statement by statement."""
    lines, depth = [], 1
    for statement in re.split(r";|\bloop\b", body):
        said = " ".join(statement.split())
        if not said:
            continue
        if said in ("end for", "end while"):
            depth -= 1
            continue
        if loop := re.fullmatch(r"for (\w+) in (\w+):(\w+)", said):
            lines.append("    " * depth + f"for {loop[1]} in range({loop[2]}, {loop[3]} + 1):")
            depth += 1
        elif loop := re.fullmatch(r"while (.*)", said):
            lines.append("    " * depth + f"while {expression(loop[1])}:")
            depth += 1
        elif ":=" in said:
            left, right = said.split(":=")
            lines.append("    " * depth + f"{left.strip()} = {expression(right)}")
        else:
            assert said.startswith("assert("), said
            lines.append("    " * depth + expression(said))
    assert depth == 1
    return lines


def functions_of(text: str) -> dict[str, Any]:
    """The package's functions and constants, ready to be called with matrices."""
    world = dict(BUILT_IN)
    plain = re.sub(r"//[^\n]*", "", re.sub(r'\s"[^"]*"(?=[;\n])', "", text))
    for name, value in re.findall(r"constant Real (\w+) = ([^;\s]+)\s*;", plain):
        world[name] = float(value)
    for name, rows in re.findall(r"constant Integer (\w+)\[[^\]]*\] = \{(.*?)\}\s*;", plain, re.DOTALL):
        numbers = [
            [int(n) for n in row.split(",")] for row in re.findall(r"\{([^{}]*)\}", "{" + rows.strip("{} \n") + "}")
        ]
        table = Matrix(np.array(numbers))
        world[name] = _Integers(table.values)
    for name, declared, body in re.findall(r"function (\w+)(.*?)\n\s*algorithm(.*?)end \1;", plain, re.DOTALL):
        inputs = re.findall(r"input Real (\w+)", declared)
        made = re.findall(r"(?:output Real|Real) (\w+)\[([\d, ]+)\]", declared)
        result = re.findall(r"output \w+ (\w+)", declared)[0]
        arrays = [f"    {array} = array(({sizes},))" for array, sizes in made]
        body = re.sub(r"annotation\([^;]*\);", "", body)
        source = [f"def {name}({', '.join(inputs)}):", *arrays, *python_of(body), f"    return {result}"]
        world["array"] = lambda sizes: Matrix(np.full(sizes, np.nan))
        exec("\n".join(source), world)
    return world


class _Integers(Matrix):
    def __getitem__(self, at: int | tuple[int, ...]) -> int:  # type: ignore[override]
        return int(super().__getitem__(at))


@pytest.fixture(scope="module")
def pair() -> PairTable:
    return read_pair_table(PAIR)


def exported(pair: PairTable, folder: Path) -> tuple[str, dict[str, Any]]:
    from msl_fem.export.pair_modelica import write_pair_modelica

    package, coefficients = write_pair_modelica(pair, folder / "servo.mo")
    return package.read_text(encoding="ascii"), loadmat(coefficients)


@pytest.fixture(scope="module")
def model(pair: PairTable, tmp_path_factory: pytest.TempPathFactory) -> Callable[..., np.ndarray]:
    text, content = exported(pair, tmp_path_factory.mktemp("modelica"))
    world, read = functions_of(text), {}
    for name, shape, rows, columns in re.findall(
        r'Real (\w+)\[([\d, ]+)\] = .*readRealMatrix\(file, "\1", (\d+), (\d+)\)', text
    ):
        assert content[name].shape == (int(rows), int(columns))
        read[name] = Matrix(content[name].ravel() if rows == "1" else content[name])
        assert read[name].values.shape == tuple(int(n) for n in shape.split(","))
    names = re.findall(r"Real q\[10\] = evaluate\(x, i1, i2, (.*)\);", text)[0].split(", ")
    return lambda x, i, j: world["evaluate"](x, i, j, *(read[name] for name in names)).values


def test_the_package_evaluates_the_tables_own_coenergy(model: Callable[..., np.ndarray], pair: PairTable) -> None:
    rng = np.random.default_rng(5)
    points = [*rng.uniform([-5e-4, -8, -8], [5e-4, 8, 8], (12, 3)), (pair.position[-1], 12.0, -12.0), (0.0, 0.0, 0.0)]
    for x, i, j in points:
        truth, found = pair.evaluate(x, i, j), model(float(x), float(i), float(j))
        for value, name in zip(found, PAIR_NODES, strict=True):
            assert value == pytest.approx(float(truth[name]), abs=1e-10 * np.abs(pair.nodes[name]).max()), name


def test_reciprocity_is_exact(model: Callable[..., np.ndarray]) -> None:
    """Fourth-order differences of one output are another one: forces and flux linkages are of one coenergy."""
    at = np.array([1.1e-4, 2.3, -1.7])
    names = list(PAIR_NODES)

    def slope(name: str, axis: int, h: float) -> float:
        step = h * np.eye(3)[axis]
        f = {k: model(*(at + k * step).tolist())[names.index(name)] for k in (-2, -1, 1, 2)}
        return float((8 * (f[1] - f[-1]) - (f[2] - f[-2])) / (12 * h))

    here = dict(zip(names, model(*at.tolist()), strict=True))
    for name, axis, h, other in (
        ("coenergy", 0, 1e-6, "force"), ("coenergy", 2, 2e-3, "flux_linkage_2"),
        ("flux_linkage_1", 2, 2e-3, "mutual_inductance"), ("flux_linkage_2", 1, 2e-3, "mutual_inductance"),
        ("force", 1, 2e-3, "force_current_slope_1"), ("flux_linkage_1", 0, 1e-6, "force_current_slope_1"),
    ):  # fmt: skip
        assert slope(name, axis, h) == pytest.approx(here[other], rel=1e-7), (name, other)


def test_nothing_is_extrapolated(model: Callable[..., np.ndarray]) -> None:
    for point in ((6e-4, 0.0, 0.0), (0.0, 12.1, 0.0), (0.0, 0.0, -12.1), (math.nan, 0.0, 0.0)):
        with pytest.raises(ValueError, match="outside the table"):
            model(*point)


def test_the_command_writes_both_files(msl_fem: Run, tmp_path: Path) -> None:
    target = tmp_path / "pair.mo"
    done = msl_fem("export", PAIR, "--to", "modelica", "-o", str(target), "--name", "servo", "--json")
    assert done.json["files"] == [str(target), str(target.with_suffix(".mat"))]
    assert target.read_text(encoding="ascii").startswith("package servo_pair ")
    complaint = msl_fem("export", PAIR, "--to", "modelica", "-o", str(tmp_path / "pair.mat")).complaint
    assert "call the package pair.mo" in complaint
