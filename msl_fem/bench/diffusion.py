"""Eddy currents in sheets: magnetic diffusion across their thickness as a ladder of resistors and inductors.

In a sheet of thickness d, conductivity s and permeability mu the field at the surface and the mean flux density obey

    H_s / B_mean = q coth(q) / mu,   q^2 = j w T,   T = mu s d^2/4

(Stoll, The Analysis of Eddy Currents, 1974, ch. 2). The excess q coth(q) - 1 = q^2/(3 + q^2/(5 + q^2/(7 + ...))) is a
ladder (Cauer's second form; Krah, IEEE Trans. Magn. 41, 2005): seen from a coil, the rate of its flux linkage e drives
3 G through resistors 3, 7, 11 ... and inductors T/5, T/9, T/13 ... to ground, and the sum of the inductors' currents is
what the eddy currents take from the coil. G = s d^2 l/(12 n N^2 A) for a path of length l and section A linked by n
coils of N turns in series: the classical loss of thin sheets.
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.bench.plant import Array, Ladder
from msl_fem.computing.compiled import compiled


@compiled
def ladder_current(ladder: Ladder, currents: Array) -> float:
    """What the eddy currents take from the side's coil, A; `currents` (stages,) are those of the inductors."""
    total = 0.0
    for k in range(ladder.stages):
        total += currents[k]
    return 3.0 * ladder.conductance * total


@compiled
def ladder_rates(ladder: Ladder, currents: Array, flux_rate: float, rates: Array) -> None:
    """Rates of the inductors' currents into `rates` (stages,).

    The node behind resistor 4k - 1 is at e - sum over l <= k of (4l - 1) (sum over m >= l of J_m).
    """
    beyond = 0.0
    for k in range(ladder.stages):
        beyond += currents[k]
    level = flux_rate
    for k in range(1, ladder.stages + 1):
        level -= (4.0 * k - 1.0) * beyond
        beyond -= currents[k - 1]
        rates[k - 1] = (4.0 * k + 1.0) / ladder.diffusion_time * level


def ladder_matrix(ladder: Ladder) -> Array:
    """The matrix (stages, stages) of the ladder's own motion, 1/s: for its poles and its transfer function."""
    columns = []
    for unit in np.eye(ladder.stages):
        rates = np.empty(ladder.stages)
        ladder_rates(ladder, unit, 0.0, rates)
        columns.append(rates)
    return np.array(columns).T


def ladder_response(ladder: Ladder, frequency: Array) -> NDArray[np.complex128]:
    """Current over flux rate, A/V, at frequencies in rad/s (n,): what `sheet_response` is approached by."""
    matrix, drive = ladder_matrix(ladder), np.empty(ladder.stages)
    ladder_rates(ladder, np.zeros(ladder.stages), 1.0, drive)
    identity = np.eye(ladder.stages)
    return np.array(
        [3 * ladder.conductance * np.linalg.solve(1j * w * identity - matrix, drive).sum() for w in frequency]
    )


def sheet_response(ladder: Ladder, frequency: Array) -> NDArray[np.complex128]:
    """The closed form 3 G (q coth q - 1)/q^2, A/V, at frequencies in rad/s (n,)."""
    q = np.sqrt(1j * np.asarray(frequency) * ladder.diffusion_time)
    return 3 * ladder.conductance * (q / np.tanh(q) - 1) / q**2


def fastest_ladder_rate(ladder: Ladder) -> float:
    """The largest pole of the ladder in 1/s; 0 without one."""
    return float(np.abs(np.linalg.eigvals(ladder_matrix(ladder))).max()) if ladder.stages else 0.0
