"""The identified model as an object of python-control, an optional package."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray
from msl_fem.identification.model import ArmaxEstimate

if TYPE_CHECKING:
    from control import TransferFunction


def transfer_matrix(model: ArmaxEstimate, *, noise: bool = False) -> TransferFunction:
    """Discrete transfer functions B_k/A from every input to the output, one row; with `noise`, C/A as last column.

    Its inputs are the model's: of rational inputs the evaluated terms, not the currents. The offset has no place in a
    transfer function and is left out. InputError without python-control.
    """
    try:
        import control
    except ImportError as err:
        raise InputError("to_control needs the package python-control: pip install control") from err
    polynomials = model.polynomials
    tops = [
        np.concatenate([np.zeros(lags[0]), b]) for lags, b in zip(model.orders.input_lags, polynomials.b, strict=True)
    ]
    names = list(model.input_names)
    if noise:
        tops.append(polynomials.c)
        names.append("innovation")
    fractions = [_in_powers_of_z(top, polynomials.a) for top in tops]
    return control.tf(
        [[top for top, _ in fractions]],
        [[bottom for _, bottom in fractions]],
        model.sampling_period,
        inputs=names,
        outputs=["y"],
    )


def _in_powers_of_z(top: FloatArray, bottom: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator in powers of z from polynomials in z^-1."""
    length = max(top.size, bottom.size)
    padded = [np.concatenate([p, np.zeros(length - p.size)]) for p in (top, bottom)]
    return padded[0], padded[1]
