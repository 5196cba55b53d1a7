"""A table as a function of CasADi, for optimal control: the coenergy surface itself, differentiated there."""

from typing import TYPE_CHECKING, Any

import numpy as np

from msl_fem.errors import InputError
from msl_fem.table.magnetic_table import NODES, MagneticTable

if TYPE_CHECKING:
    import casadi


def casadi_function(table: MagneticTable, *, name: str = "magnet") -> "casadi.Function":
    """The function (current in A, gap in m) to the quantities of a table, by their names, in SI units.

    The piecewise biquintic polynomials are those of `table.surface`; flux linkage, force and slopes are CasADi's own
    derivatives of the coenergy, so that an optimiser gets exact gradients. Outside the table all are nan.

    Raises
    ------
    InputError : casadi is not installed
    """
    try:
        import casadi as ca
    except ImportError as err:
        raise InputError("a function of CasADi needs casadi: pip install casadi") from err
    surface = table.surface
    i, g = ca.MX.sym("current"), ca.MX.sym("gap")
    size = ca.if_else(i >= 0, i, -i)  # not fabs, whose slope at 0 is 0
    m, n = ca.low(ca.DM(surface.gap), g), ca.low(ca.DM(surface.current), size)
    gap_node, current_node = (_at(ca, nodes, k) for nodes, k in ((surface.gap, m), (surface.current, n)))
    y, x = g - gap_node, size - current_node
    powers = ca.kron(ca.vcat([y**p for p in range(6)]), ca.vcat([x**q for q in range(6)]))
    cells = surface.coefficients.reshape(-1, 36)
    first = 36 * (m * (surface.current.size - 1) + n)
    coenergy = ca.dot(_at(ca, cells.ravel(), first + ca.DM(np.arange(36))), powers)
    values = _quantities(ca, coenergy, i, g)
    inside = ca.logic_and(ca.logic_and(g >= table.gap[0], g <= table.gap[-1]), size <= table.current[-1])
    outputs = [ca.if_else(inside, values[quantity], np.nan) for quantity in NODES]
    return ca.Function(name, [i, g], outputs, ["current", "gap"], list(NODES))


def _quantities(ca: Any, coenergy: Any, i: Any, g: Any) -> dict[str, Any]:
    """The quantities of `NODES` as derivatives of the coenergy."""
    linkage, force = ca.gradient(coenergy, i), -ca.gradient(coenergy, g)
    return {
        "coenergy": coenergy,
        "flux_linkage": linkage,
        "force": force,
        "incremental_inductance": ca.gradient(linkage, i),
        "force_current_slope": ca.gradient(force, i),
        "force_gap_slope": ca.gradient(force, g),
    }


def _at(ca: Any, values: Any, index: Any) -> Any:
    """The elements of constants at a computed index."""
    return ca.MX(ca.DM(values)).get_nz(False, index)
