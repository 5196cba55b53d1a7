"""Rational inputs: current power over gap power, so that a magnet's force becomes linear in its coefficients.

H. M. Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (1)-(3): f_j = sum a_pq i_j^p / (g_j + delta)^q, each
term a separate input of a linear MISO system. Gap of side 1: g_1 = g0 - x, of side 2: g_2 = g0 + x. No sign is built
in: the coefficient of a term of side 2 comes out negative by itself.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.data import FloatArray, SampledRun

_TERM = re.compile(r"^i(?P<side>[12])(\^(?P<p>\d+))?(/\(?g(?P<gap>[12])\)?(\^(?P<q>\d+))?)?$")


@dataclass(frozen=True)
class RationalTerm:
    """i_side^current_power / (gap of that side + delta)^gap_power."""

    side: int
    current_power: int
    gap_power: int

    def __post_init__(self) -> None:
        if self.side not in (1, 2) or self.current_power < 1 or self.gap_power < 0:
            raise InputError(
                f"rational term side {self.side}, current power {self.current_power}, gap power {self.gap_power}: "
                "the side is 1 or 2, the current power 1 or more, the gap power 0 or more"
            )

    def __str__(self) -> str:
        current = f"i{self.side}" + (f"^{self.current_power}" if self.current_power > 1 else "")
        gap = f"/g{self.side}" + (f"^{self.gap_power}" if self.gap_power > 1 else "")
        return current + (gap if self.gap_power else "")

    @property
    def current_name(self) -> str:
        """Name of the channel that holds this side's current: "i1" or "i2"."""
        return f"i{self.side}"

    @property
    def gap_sign(self) -> int:
        """Derivative of this side's gap by the position: -1 for side 1, +1 for side 2."""
        return -1 if self.side == 1 else 1


def rational_term(text: str) -> RationalTerm:
    """The term that a text such as "i1^2/g1^2", "i2/g2" or "i1^2" stands for; InputError if it is none."""
    match = _TERM.match(text.replace(" ", ""))
    if match is None:
        raise InputError(f"{text!r} is no rational term: write i<side>^<power>/g<side>^<power> as in i1^2/g1^2")
    if match["gap"] is not None and match["gap"] != match["side"]:
        raise InputError(
            f"{text!r} divides side {match['side']}'s current by the other side's gap: use g{match['side']}"
        )
    gap_power = 0 if match["gap"] is None else int(match["q"] or 1)
    return RationalTerm(int(match["side"]), int(match["p"] or 1), gap_power)


@dataclass(frozen=True)
class RationalInputs:
    """Terms, nominal gap g0 (m), gap offset delta (m), and the channels that enter as they are (an external force)."""

    terms: tuple[RationalTerm, ...]
    nominal_gap: float
    delta: float = 0.0
    plain: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.terms:
            raise InputError("no rational term was given: list at least one, such as i1^2/g1^2")
        if len(set(self.terms)) != len(self.terms):
            raise InputError(f"a rational term is listed twice: {', '.join(map(str, self.terms))}")
        if not (np.isfinite(self.nominal_gap) and self.nominal_gap > 0.0):
            raise InputError(f"nominal gap {self.nominal_gap!r} m: give a positive one")

    @property
    def input_names(self) -> tuple[str, ...]:
        """Names of the model's inputs: the terms in writing, then the plain channels."""
        return (*map(str, self.terms), *self.plain)

    @property
    def needs_gap(self) -> bool:
        """Whether any term depends on the gap, so that delta means something."""
        return any(term.gap_power for term in self.terms)

    def with_delta(self, delta: float) -> RationalInputs:
        """The same terms with another gap offset."""
        return replace(self, delta=delta)

    def gap(self, term: RationalTerm, position: FloatArray) -> FloatArray:
        """Gap of a term's side with the offset, in m, shape of `position`."""
        return self.nominal_gap + self.delta + term.gap_sign * position

    def evaluated(self, run: SampledRun) -> SampledRun:
        """The run with the terms, at the measured position, and the plain channels as inputs.

        InputError if a channel is missing or a gap is closed at some sample.
        """
        inputs: dict[str, FloatArray] = {}
        for term in self.terms:
            current = np.asarray(_channel(run, term.current_name), dtype=float)
            gap = self._open_gap(term, run)
            inputs[str(term)] = current**term.current_power / gap**term.gap_power
        inputs |= {name: np.asarray(_channel(run, name), dtype=float) for name in self.plain}
        return replace(run, inputs=inputs)

    def delta_derivatives(self, run: SampledRun) -> FloatArray:
        """Derivatives of the inputs by delta, shape (n_inputs, n_samples)."""
        rows = np.zeros((len(self.input_names), run.n_samples))
        values = self.evaluated(run).inputs
        for row, term in enumerate(self.terms):
            rows[row] = -term.gap_power * values[str(term)] / self._open_gap(term, run)
        return rows

    def mean_slopes(self, runs: Sequence[SampledRun]) -> tuple[float, ...]:
        """Mean over all samples of each input's derivative by the position: the gap moves with its sign."""
        total = sum(self.delta_derivatives(run).sum(axis=1) for run in runs)
        signs = [*(term.gap_sign for term in self.terms), *(0 for _ in self.plain)]
        return tuple((np.array(signs) * total / sum(run.n_samples for run in runs)).tolist())

    def smallest_gap(self, runs: Sequence[SampledRun]) -> float:
        """Smallest measured gap without the offset over the terms that have one, in m; inf if none has."""
        gaps = [
            float(np.min(self.nominal_gap + term.gap_sign * np.asarray(run.output)))
            for run in runs
            for term in self.terms
            if term.gap_power
        ]
        return min(gaps, default=float("inf"))

    def _open_gap(self, term: RationalTerm, run: SampledRun) -> FloatArray:
        gap = self.gap(term, np.asarray(run.output, dtype=float))
        if term.gap_power and gap.min() <= 0.0:
            sample = int(np.argmin(gap))
            raise InputError(
                f"run {run.name!r}: the gap of side {term.side} is {gap[sample]:.3g} m at sample {sample} with "
                f"g0 = {self.nominal_gap:g} m and delta = {self.delta:g} m: check the nominal gap and the "
                "position's zero and unit"
            )
        return gap


def _channel(run: SampledRun, name: str) -> FloatArray:
    if name not in run.inputs:
        raise InputError(f"run {run.name!r} has no channel {name!r}; it has {', '.join(run.inputs)}")
    return run.inputs[name]
