"""Inductance over frequency and stroke: which currents in the iron make it fall, and what they leave.

At each stroke x a coil has L(s) = l + L_0(x) f(s tau(x)): l a leakage that is the same at all strokes, L_0 the rest at
low frequency, f how the flux follows the current: 1 without induced currents, 1/(1 + s tau) with a shorted winding (a
bobbin, a housing, a tube; eddy_currents with diffusion time 0), tanh(q)/q with q^2 = s tau in sheets, 1/(1 + q) in
solid iron behind a gap. The meter reads Re L as inductance and -w Im L beside the coil's resistance.
Sources: R. L. Stoll, The Analysis of Eddy Currents, 1974, ch. 2; Zhu, Knospe, Maslen, IEEE Trans. Magn. 41(4), 2005.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.record.impedance import ImpedanceMap

Complex = NDArray[Any]
LAWS: Mapping[str, Callable[[Complex], Complex]] = {
    "no induced currents": lambda s: np.ones_like(s),
    "a shorted winding": lambda s: 1 / (1 + s),
    "sheets": lambda s: np.tanh(np.sqrt(s)) / np.sqrt(s),
    "solid iron": lambda s: 1 / (1 + np.sqrt(s)),
}
"""f(s tau) by what carries the currents; the first has no tau."""
PLAIN = "no induced currents"
NATS = 12.0
"""Evidence that a law has to bring over none, and over the next one to be named alone."""
CLOSE = 0.05
"""Share of the inductance within which a named law follows every row."""
LEAST_NOISE = 1e-3  # of the inductance: what an LCR meter is good for


@dataclass(frozen=True, eq=False)
class InductanceLaw:
    """A law fitted to all rows.

    Attributes
    ----------
    name : of `LAWS`
    leakage : H
    stroke : (n_stroke,) m
    inductance, time_constant : (n_stroke,) H at rest without leakage, s
    error : (n_row,) fitted over measured less 1
    nats : log likelihood less half the number of parameters times ln(n_row), Schwarz's criterion
    """

    name: str
    leakage: float
    stroke: Array
    inductance: Array
    time_constant: Array
    error: Array
    nats: float

    @property
    def largest_error(self) -> float:
        return float(np.abs(self.error).max())

    def at(self, frequency: Array, stroke: Array) -> Complex:
        """L (n_row,) at measured strokes, H; its imaginary part is that of the losses."""
        k = np.searchsorted(self.stroke, stroke)
        s = 2j * np.pi * np.asarray(frequency) * self.time_constant[k]
        return np.asarray(self.leakage + self.inductance[k] * LAWS[self.name](s))


@dataclass(frozen=True, eq=False)
class ImpedanceDiagnosis:
    """What accounts for an impedance map.

    Attributes
    ----------
    verdict, reason : "nothing-found", "named", "unexplained" or "undecidable", and why
    laws : the most probable first
    """

    verdict: str
    reason: str
    laws: tuple[InductanceLaw, ...] = ()

    def to_json(self) -> dict[str, Any]:
        """In the words of a record's diagnosis."""
        best = self.laws[0] if self.laws else None
        causes: list[dict[str, Any]] = []
        if best is not None and self.verdict == "named":
            times = {}
            for stroke, tau in zip(best.stroke, best.time_constant, strict=True):
                times[f"time_constant at {stroke:g} m"] = {"value": float(tau), "unit": "s"}
            leakage = {"inductance": {"value": best.leakage, "unit": "H"}}
            causes.append({"effect": "eddy_currents", "carried_by": best.name, "parameters": times})
            causes.append({"effect": "leakage_inductance", "parameters": leakage})
        tried = [{"law": it.name, "nats": it.nats, "largest_error": it.largest_error} for it in self.laws]
        return {"schema": 1, "verdict": self.verdict, "reason": self.reason, "causes": causes, "laws": tried}


def diagnose_impedance(measured: ImpedanceMap) -> ImpedanceDiagnosis:
    """Which law an impedance map obeys.

    Raises
    ------
    InputError : fewer than three frequencies at a stroke: a leakage, an inductance and a time are not told apart
    """
    strokes, place = np.unique(measured.stroke, return_inverse=True)
    fewest = min(np.unique(measured.frequency[place == k]).size for k in range(strokes.size))
    if fewest < 3 or measured.inductance.size < 2 * strokes.size + 4:
        raise InputError(
            f"impedance.csv has {fewest} frequencies at a stroke; at least 3 at each are needed, and 4 more rows in all"
        )
    laws = tuple(sorted((fit_law(name, measured) for name in LAWS), key=lambda law: -law.nats))
    best, plain = laws[0], next(law for law in laws if law.name == PLAIN)
    if best.nats - plain.nats < NATS:
        if plain.largest_error > CLOSE:
            reason = f"no law brings {NATS:.0f} nats over a constant, which errs by up to {plain.largest_error:.1%}"
            return ImpedanceDiagnosis("unexplained", reason, laws)
        return ImpedanceDiagnosis("nothing-found", "the inductance does not depend on the frequency", laws)
    told = f"{best.name} brings {best.nats - plain.nats:.0f} nats and follows every row within {best.largest_error:.1%}"
    if best.largest_error > CLOSE:
        return ImpedanceDiagnosis("unexplained", f"{told}; a law that is named leaves {CLOSE:.0%} at most", laws)
    behind = f"next is {laws[1].name}, {best.nats - laws[1].nats:.0f} nats behind"
    return ImpedanceDiagnosis("named", f"{told}; {behind}", laws)


def fit_law(name: str, measured: ImpedanceMap) -> InductanceLaw:
    """A law fitted to the logarithms of the inductance, and of the resistance's rise where it was measured."""
    strokes, place = np.unique(measured.stroke, return_inverse=True)
    plain = name == PLAIN
    low = np.array([measured.inductance[place == k].max() for k in range(strokes.size)])
    middle = 2 * np.pi * float(np.exp(np.mean(np.log(measured.frequency))))
    fits = []
    times = 0 if plain else strokes.size
    for start in (0.3 / middle, 3.0 / middle):
        begin = np.log([0.5 * measured.inductance.min(), *low, *np.full(times, start)])
        fits.append(least_squares(_missed, begin, args=(name, measured, place, strokes.size), max_nfev=300))
    best = min(fits, key=lambda fitted: fitted.cost)
    leakage, inductance, tau = _parts(best.x, strokes.size)
    rows = best.fun.size
    variance = max(2 * best.cost / rows, LEAST_NOISE**2)
    nats = -0.5 * rows * np.log(2 * np.pi * variance) - best.cost / variance - 0.5 * best.x.size * np.log(rows)
    error = np.expm1(best.fun[: measured.inductance.size])
    return InductanceLaw(name, leakage, strokes, inductance, tau, error, float(nats))


def _parts(x: Array, n: int) -> tuple[float, Array, Array]:
    """Leakage, inductances and times (n,) of the logarithms that are fitted; times 0 of the law without."""
    values = np.exp(np.clip(x, -60, 60))
    return float(values[0]), values[1 : n + 1], values[n + 1 :] if x.size > n + 1 else np.zeros(n)


def _missed(x: Array, name: str, measured: ImpedanceMap, place: NDArray[np.intp], n: int) -> Array:
    leakage, inductance, tau = _parts(x, n)
    omega = 2 * np.pi * measured.frequency
    modelled = leakage + inductance[place] * LAWS[name](1j * omega * tau[place] + 1e-30)
    missed = np.log(np.maximum(modelled.real, 1e-30) / measured.inductance)
    if measured.resistance is None:
        return np.asarray(missed)
    lost = -omega * modelled.imag
    copper = float(np.median(measured.resistance - lost))
    return np.concatenate([missed, (lost + copper) / measured.resistance - 1])
