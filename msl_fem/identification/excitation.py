"""Whether the inputs excite what the model wants to know: the rank of their delayed samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray
from msl_fem.identification.polynomials import ArmaxOrders
from msl_fem.identification.regression import LaggedColumn, lagged_blocks, scaled_factor, triangular_factor

RANK_DEFICIENT = 1e11  # condition number of scaled columns beyond which the data's rounding decides


def check_excitation(runs: Sequence[FloatArray], orders: ArmaxOrders, names: Sequence[str]) -> float:
    """Condition number of the inputs' delayed samples, columns scaled; InputError that names the dependent inputs.

    With the offset, its column of ones counts as an input.
    """
    columns: list[LaggedColumn] = []
    owners: list[str] = []
    for row, (name, lags) in enumerate(zip(names, orders.input_lags, strict=True), start=1):
        columns += [(row, lag) for lag in lags]
        owners += [name] * len(lags)
    if orders.offset:
        columns.append((len(names) + 1, 0))
        owners.append("offset")
    condition, weights = _null_direction(runs, columns, orders)
    if condition < RANK_DEFICIENT:
        return condition
    involved = _involved(weights, owners)
    if len(involved) == 1:
        raise InputError(
            f"input {involved[0]!r} does not excite as many coefficients as its order asks for "
            f"(condition number {condition:.2g} of its delayed samples): lower nb or excite with a richer signal"
        )
    raise InputError(
        f"the inputs {', '.join(map(repr, involved))} are linearly dependent (condition number {condition:.2g} "
        "of their delayed samples): leave one out, add them into one, or excite them independently"
    )


def check_feedback(runs: Sequence[FloatArray], orders: ArmaxOrders, names: Sequence[str]) -> None:
    """Nothing; raises InputError when past outputs determine an input: feedback without external excitation."""
    if orders.na == 0:
        return
    for row, (name, lags) in enumerate(zip(names, orders.input_lags, strict=True), start=1):
        columns = [(0, lag) for lag in range(1, orders.na + 1)] + [(row, lags[0])]
        condition, weights = _null_direction(runs, columns, orders)
        if condition >= RANK_DEFICIENT and weights[-1] > 0.1 * weights.max():
            raise InputError(
                f"input {name!r} is a linear function of past outputs (condition number {condition:.2g}): "
                "under feedback the plant is seen only through an external excitation; add one"
            )


def _null_direction(
    runs: Sequence[FloatArray], columns: list[LaggedColumn], orders: ArmaxOrders
) -> tuple[float, FloatArray]:
    """Condition number of the scaled columns and the sizes of each in the least excited combination."""
    # The target column is a copy of the first one: only the decomposition of the others is looked at.
    wanted = [*columns, columns[0]]
    first = replace(orders, nc=0).longest_lag
    blocks = (block for signals in runs for block in lagged_blocks(signals, wanted, first=first))
    factor = scaled_factor(triangular_factor(blocks, len(wanted)))
    return factor.condition_number, np.abs(factor.right[-1])


def _involved(weights: FloatArray, owners: Sequence[str]) -> list[str]:
    """Owners with a notable part in a combination, in order and once each."""
    limit = 0.1 * weights.max()
    return list(dict.fromkeys(name for name, weight in zip(owners, weights, strict=True) if weight > limit))
