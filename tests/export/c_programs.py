"""Small C programs around exported headers: compiled strictly, fed and read in binary."""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

STRICT = ("-Wall", "-Wextra", "-Werror", "-pedantic")
VARIANTS = {
    "gcc -O0": ("gcc", "-std=c99", "-O0"),
    "gcc -O2": ("gcc", "-std=c99", "-O2"),
    "gcc, fused products at hand": ("gcc", "-std=gnu17", "-O3", "-march=native"),
    "clang -O2": ("clang", "-std=c99", "-O2"),
    "g++": ("g++", "-std=c++17", "-O2", "-x", "c++"),
}
"""How a board's programmer may compile."""
READ_AND_WRITE = r"""
#include <stdio.h>
#include "exported.h"
/* doubles in pairs (current, gap) on stdin; for each pair n_out doubles on stdout */
int main(void)
{
    double pair[2], out[n_out];
    while (fread(pair, sizeof pair[0], 2, stdin) == 2) {
        judge(pair[0], pair[1], out);
        if (fwrite(out, sizeof out[0], n_out, stdout) != n_out)
            return 2;
    }
    return self_check();
}
"""


def compiler(name: str) -> str:
    """The path of a compiler; the test is skipped where there is none, but in CI gcc must be there."""
    found = shutil.which(name)
    if found is None:
        if name == "gcc" and os.environ.get("CI"):
            pytest.fail("gcc is not installed, and CI must compile what is exported (.ci/run installs it)")
        pytest.skip(f"{name} is not installed")
    return found


def compile_c(folder: Path, source: str, variant: str, *more: str) -> Path:
    """The program of a source that may include what stands in the folder; no warning is let pass."""
    name, *flags = VARIANTS[variant]
    path, program = folder / "program.c", folder / "program"
    path.write_text(source)
    done = subprocess.run(
        [compiler(name), *STRICT, *flags, *more, "-o", program, path], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[:3000]
    return program


def run_pairs(program: Path, current: np.ndarray, gap: np.ndarray, n_out: int) -> np.ndarray:
    """(n, n_out) of what the program answers; its own check must have passed."""
    given = np.column_stack([current, gap]).tobytes()
    done = subprocess.run([program], input=given, capture_output=True, check=False)
    assert done.returncode == 0, f"self-check: {done.returncode}"
    return np.frombuffer(done.stdout).reshape(-1, n_out)


def assert_same_bits(found: np.ndarray, wanted: np.ndarray) -> None:
    """Equal to the last bit and the sign of zero; what is not a number counts as equal whatever its bits."""
    found, wanted = np.ascontiguousarray(found), np.ascontiguousarray(wanted)
    same = (found.view(np.int64) == wanted.view(np.int64)) | (np.isnan(found) & np.isnan(wanted))
    at = np.argwhere(~same)
    assert at.size == 0, f"{len(at)} differ, first at {at[0]}: {found[tuple(at[0])]!r} and {wanted[tuple(at[0])]!r}"


def any_doubles(rng: np.random.Generator, n: int) -> np.ndarray:
    """(n,) doubles of random bits: of all sizes, subnormal, infinite, no numbers with all payloads."""
    bits = rng.integers(0, 2**64, n, dtype=np.uint64)
    bits[::3] &= np.uint64(0x800FFFFFFFFFFFFF)  # subnormal
    bits[1::7] |= np.uint64(0x7FF0000000000000)  # infinite or no number
    return bits.view(np.float64).copy()
