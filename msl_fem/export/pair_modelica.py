"""The table of a pair for Modelica: a package that evaluates its one coenergy, and the coefficients in a MAT-file.

The library's tables end at two variables. The package has its own lookup, of the polynomials that Python evaluates, so
force and both flux linkages are derivatives of one function there too.
"""

from pathlib import Path
from typing import Any

from scipy.io import savemat

from msl_fem.errors import InputError
from msl_fem.export.c_text import c_header, c_prefix
from msl_fem.files.whole_file import whole_file
from msl_fem.table.pair_table import PAIR_NODES, PairTable

EXTENSION = ".mat"
"""Of the file of coefficients, which lies beside the package."""


def modelica_coefficients(table: PairTable) -> dict[str, Any]:
    """Variable of the MAT-file to matrix.

    position (1, n_x) m, current_1 (1, n_1), current_2 (1, n_2) A, common (n_x n_1 n_2, 27): what both sides have in
    common and its derivatives at the nodes; gap (1, n_gap) m, current (1, n_current) A, alone (cells, 36): the
    polynomials of one magnet, powers of the current the fastest.
    """
    common, alone = table.difference, table.one_sided.surface
    axes = {"position": common.position, "current_1": common.current_1, "current_2": common.current_2}
    axes |= {"gap": alone.gap, "current": alone.current}
    return {name: nodes[None, :] for name, nodes in axes.items()} | {
        "common": common.hermite.reshape(-1, common.hermite.shape[-1]),
        "alone": alone.coefficients.reshape(-1, alone.coefficients.shape[-1] * alone.coefficients.shape[-2]),
    }


def pair_modelica_text(table: PairTable, *, name: str | None, file: str) -> str:
    """The package's text; `file` is the name of the file of coefficients. InputError for a name that is none."""
    provenance = dict(table.provenance)
    prefix = c_prefix(str(provenance.get("actuator", "")), name)
    content = {
        "name": f"{prefix}_pair",
        "file": file,
        "gap_sum": repr(float(table.gap_sum)),
        "sizes": {key: values.shape for key, values in modelica_coefficients(table).items()},
        "actuator": provenance.get("actuator") or "not known",
        "digest": provenance.get("actuator_sha256") or "not known",
        "mesh_error": table.mesh_error,
        "interpolation_error": table.interpolation_error,
        "outputs": [(key, unit, what) for key, (unit, what) in PAIR_NODES.items()],
    }
    return c_header("pair.mo.j2", prefix, content)


def write_pair_modelica(table: PairTable, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The package and the file of coefficients beside it. Raises InputError where the folder cannot be written."""
    beside = target.with_suffix(EXTENSION)
    if beside == target:
        raise InputError(f"{target}: the package's coefficients take this name; call the package {target.stem}.mo")
    if '"' in beside.name or "\\" in beside.name or not beside.name.isascii():
        raise InputError(f"the package names its file of coefficients, {beside.name!r}; use plain letters and digits")
    text = pair_modelica_text(table, name=name, file=beside.name)
    variables = modelica_coefficients(table)
    with whole_file(beside) as partial:
        savemat(partial, variables, appendmat=False, oned_as="row")
    with whole_file(target) as partial:
        partial.write_text(text, encoding="ascii", newline="\n")
    return target, beside
