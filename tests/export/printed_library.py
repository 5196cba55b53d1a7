"""Printed functions as a shared library: called from Python with numbers and rows, bit for bit as C computes."""

import ctypes
import subprocess
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from c_programs import STRICT, compiler

from msl_fem.export.c_printer import Printer
from msl_fem.export.c_types import FLAG, NOTHING, REAL, WHOLE, Number, PrintedFunction, Several

AS_COMPILED = ("-march=native", "-ffp-contract=off", "-fno-tree-slp-vectorize")
"""As the compiled Python: products are fused with sums where it says so, and nowhere else. gcc 12's vectoriser of
straight lines fuses them in pairs (vfmaddsub) whatever it is told of contraction."""
_FLAGS = ("-std=c99", "-O2", *AS_COMPILED, "-fPIC", "-shared", "-Wno-unused-function")


def _numbers(kind: Any, text: str) -> list[str]:
    """What a result consists of, number by number."""
    if isinstance(kind, Several):
        return [one for n, part in enumerate(kind.parts) for one in _numbers(part, f"{text}.a{n}")]
    return [text]


def _wrapper(function: PrintedFunction) -> str:
    """void call_NAME(double **rows, const double *numbers, double *out)"""
    given, rows, numbers = [], 0, 0
    for _, kind in function.parameters:
        if isinstance(kind, Number):
            given.append(f"({kind.c})numbers[{numbers}]")
            numbers += 1
        else:
            given.append(f"(void *)rows[{rows}]")
            rows += 1
    call = f"{function.name}({', '.join(given)})"
    lines = [f"    {call};"]
    if function.result != NOTHING:
        lines = [f"    {function.result.declared('found')} = {call};"]
        lines += [f"    out[{n}] = {text};" for n, text in enumerate(_numbers(function.result, "found"))]
    body = "\n".join(lines)
    return (
        f"void call_{function.name}(double **rows, const double *numbers, double *out);\n"
        f"void call_{function.name}(double **rows, const double *numbers, double *out)\n"
        f"{{\n    (void)rows, (void)numbers, (void)out;\n{body}\n}}\n"
    )


class PrintedLibrary:
    """Functions for arguments of stated types, printed and compiled without a warning."""

    def __init__(self, folder: Path, functions: Mapping[Any, Mapping[str, Any]]) -> None:
        printer = Printer()
        self._printed = {function: printer.add(function, kinds) for function, kinds in functions.items()}
        wrappers = "\n".join(_wrapper(one) for one in self._printed.values())
        (folder / "printed.c").write_text(f"#include <math.h>\n{printer.declarations}{printer.definitions}{wrappers}")
        subprocess.run(
            [compiler("gcc"), *STRICT, *_FLAGS, "-o", "printed.so", "printed.c", "-lm"], cwd=folder, check=True
        )
        self._library = ctypes.CDLL(str(folder / "printed.so"))

    def call(self, function: Callable[..., Any], *arguments: Any) -> list[float]:
        """The numbers that it returns; arrays among the arguments are written to."""
        printed = self._printed[function]
        rows = [a for a in arguments if isinstance(a, np.ndarray)]
        numbers = np.array([float(a) for a in arguments if not isinstance(a, np.ndarray)] or [0.0])
        n_out = 0 if printed.result == NOTHING else len(_numbers(printed.result, ""))
        out = np.zeros(n_out + 1)
        pointer = ctypes.POINTER(ctypes.c_double)
        addresses = (pointer * (len(rows) + 1))(*(a.ctypes.data_as(pointer) for a in rows))
        getattr(self._library, f"call_{printed.name}")(
            addresses, numbers.ctypes.data_as(pointer), out.ctypes.data_as(pointer)
        )
        return out[:n_out].tolist()


KINDS = {"r": REAL, "n": WHOLE, "b": FLAG}
"""Types by letter."""
