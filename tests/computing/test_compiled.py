"""Compiled functions and their cache."""

import subprocess
import sys
from pathlib import Path

import numpy as np

from msl_fem.computing import compiled as module
from msl_fem.table.coenergy_surface import evaluate, evaluate_slopes
from msl_fem.table.magnetic_table import MagneticTable


def test_a_change_of_any_compiled_source_changes_the_digest(tmp_path: Path) -> None:
    """A copy of the package gives the same digest; one comment in a compiled file another; a plain file none."""
    package = tmp_path / "msl_fem"
    for path in Path(module.__file__).parent.rglob("*.py"):
        target = package / path.relative_to(Path(module.__file__).parent)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(path.read_bytes())

    def digest() -> str:
        code = "from msl_fem.computing.compiled import DIGEST; print(DIGEST)"
        done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    first = digest()
    assert first == module.DIGEST
    with (package / "errors.py").open("a") as plain:
        plain.write("# a comment\n")
    assert digest() == first
    with (package / "coupled_model" / "side.py").open("a") as source:
        source.write("# a comment\n")
    assert digest() != first


def test_the_cheap_evaluation_agrees_with_the_whole_one(table: MagneticTable) -> None:
    surface = table.surface
    arrays = (surface.gap, surface.current, surface.coefficients)
    generator = np.random.default_rng(0)
    out = np.empty(6)
    for _ in range(500):
        i, g = generator.uniform(-12, 12), generator.uniform(5e-5, 1.2e-3)
        assert evaluate(*arrays, i, g, out)
        inside, *slopes = evaluate_slopes(*arrays, i, g)
        assert inside
        np.testing.assert_allclose(slopes, out[2:5], rtol=1e-10, atol=1e-12)
    for i, g in ((13.0, 5e-4), (1.0, 2e-3), (np.nan, 5e-4), (1.0, np.nan), (1.0, 4.9e-5)):
        assert not evaluate_slopes(*arrays, i, g)[0]
        assert not evaluate(*arrays, i, g, out)
    for edge in surface.gap:
        assert evaluate_slopes(*arrays, 1.0, edge)[0]
