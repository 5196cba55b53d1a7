"""Sampled input/output data of one run, what makes it unfit for identification, and rational inputs made of it.

A rational input is a current power over a gap power, so that a magnet's force becomes linear in its coefficients (H. M.
Gutierrez and P. I. Ro, IEEE Trans. Magn. 34(5), 1998, eqs. (1)-(3)): f_j = sum a_pq i_j^p / (g_j + delta)^q, each term
a separate input of a linear MISO system. Gap of side 1: g_1 = g0 - x, of side 2: g_2 = g0 + x. No sign is built in: the
coefficient of a term of side 2 comes out negative by itself.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError

PERIOD_MISMATCH = 1e-6  # relative; runs of one fit share their sampling period to this
CONSTANT_SPAN = 1e-12  # a channel that moves less than this part of its level is constant to rounding


@dataclass(frozen=True, eq=False)
class SampledRun:
    """One run of equidistant samples: the output and the named inputs, all of shape (n_samples,), SI units.

    `sampling_period` is in seconds. The order of `inputs` is the order of the model's inputs.
    """

    output: Array
    inputs: Mapping[str, Array]
    sampling_period: float
    name: str = "run"
    output_name: str = field(default="output", kw_only=True)

    @property
    def n_samples(self) -> int:
        """Number of samples of the output."""
        return int(np.asarray(self.output).shape[0])

    @property
    def signals(self) -> Array:
        """Rows output, inputs, ones: shape (2 + n_inputs, n_samples)."""
        rows = [self.output, *self.inputs.values(), np.ones(self.n_samples)]
        return np.ascontiguousarray(np.vstack([np.asarray(row, dtype=float) for row in rows]))


def check_runs(runs: Sequence[SampledRun], *, moving: bool = True) -> None:
    """Nothing; raises InputError that names run and channel when the runs cannot be used together.

    With `moving`, no channel may be constant over all runs.
    """
    if not runs:
        raise InputError("no run was given: identification needs at least one run of input/output data")
    first = runs[0]
    if not first.inputs:
        raise InputError(f"run {first.name!r} has no input: an ARMAX model needs at least one")
    for run in runs:
        _check_channels(run)
        if tuple(run.inputs) != tuple(first.inputs):
            raise InputError(
                f"run {run.name!r} has the inputs {', '.join(run.inputs)} but run {first.name!r} has "
                f"{', '.join(first.inputs)}: give every run the same inputs in the same order"
            )
        if abs(run.sampling_period / first.sampling_period - 1.0) > PERIOD_MISMATCH:
            raise InputError(
                f"run {run.name!r} is sampled every {run.sampling_period:g} s but run {first.name!r} every "
                f"{first.sampling_period:g} s: one discrete-time model needs one rate; resample one of them"
            )
    if moving:
        _check_movement(runs)


def check_length(runs: Sequence[SampledRun], *, samples_needed: int, longest_lag: int) -> None:
    """Nothing; raises InputError when the runs hold fewer samples than the model's coefficients deserve."""
    usable = sum(max(run.n_samples - longest_lag, 0) for run in runs)
    shortest = min(runs, key=lambda run: run.n_samples)
    if usable < samples_needed or shortest.n_samples <= 2 * longest_lag + 1:
        raise InputError(
            f"too few samples: {usable} usable over {len(runs)} run(s) (shortest: {shortest.name!r} with "
            f"{shortest.n_samples}), at least {samples_needed} are needed for these orders and more than "
            f"{2 * longest_lag + 1} in each run; record longer or lower the orders"
        )


def _check_channels(run: SampledRun) -> None:
    if not (np.isfinite(run.sampling_period) and run.sampling_period > 0.0):
        raise InputError(f"run {run.name!r} has the sampling period {run.sampling_period!r} s: give a positive one")
    channels = {run.output_name: run.output, **run.inputs}
    if len(channels) != 1 + len(run.inputs):
        raise InputError(f"run {run.name!r} has an input with the output's name {run.output_name!r}: rename one")
    for name, values in channels.items():
        samples = np.asarray(values)
        if samples.ndim != 1:
            raise InputError(f"run {run.name!r}: {name!r} has shape {samples.shape}, expected (n_samples,)")
        if samples.shape[0] != run.n_samples:
            raise InputError(
                f"run {run.name!r}: {name!r} has {samples.shape[0]} samples but {run.output_name!r} has "
                f"{run.n_samples}: all channels of a run need the same length"
            )
        bad = np.flatnonzero(~np.isfinite(samples))
        if bad.size:
            raise InputError(
                f"run {run.name!r}: {name!r} is not finite at sample {bad[0]} ({bad.size} such samples): "
                "cut the run there or repair the samples"
            )


def _check_movement(runs: Sequence[SampledRun]) -> None:
    """A channel that never moves says nothing: refuse it by name."""
    names = [(runs[0].output_name, True)] + [(name, False) for name in runs[0].inputs]
    for name, is_output in names:
        parts = [np.asarray(run.output if is_output else run.inputs[name], dtype=float) for run in runs]
        low = min(float(p.min()) for p in parts)
        high = max(float(p.max()) for p in parts)
        if high - low <= CONSTANT_SPAN * max(abs(low), abs(high)):
            what = "output" if is_output else "input"
            way_out = (
                "check the sensor"
                if is_output
                else "leave it out (a constant force is the orders' offset=True) or excite it"
            )
            raise InputError(f"{what} {name!r} is constant ({low:g}) in all runs and tells nothing: {way_out}")


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

    def gap(self, term: RationalTerm, position: Array) -> Array:
        """Gap of a term's side with the offset, in m, shape of `position`."""
        return self.nominal_gap + self.delta + term.gap_sign * position

    def evaluated(self, run: SampledRun) -> SampledRun:
        """The run with the terms, at the measured position, and the plain channels as inputs.

        InputError if a channel is missing or a gap is closed at some sample.
        """
        inputs: dict[str, Array] = {}
        for term in self.terms:
            current = np.asarray(_channel(run, term.current_name), dtype=float)
            gap = self._open_gap(term, run)
            inputs[str(term)] = current**term.current_power / gap**term.gap_power
        inputs |= {name: np.asarray(_channel(run, name), dtype=float) for name in self.plain}
        return replace(run, inputs=inputs)

    def delta_derivatives(self, run: SampledRun) -> Array:
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

    def _open_gap(self, term: RationalTerm, run: SampledRun) -> Array:
        gap = self.gap(term, np.asarray(run.output, dtype=float))
        if term.gap_power and gap.min() <= 0.0:
            sample = int(np.argmin(gap))
            raise InputError(
                f"run {run.name!r}: the gap of side {term.side} is {gap[sample]:.3g} m at sample {sample} with "
                f"g0 = {self.nominal_gap:g} m and delta = {self.delta:g} m: check the nominal gap and the "
                "position's zero and unit"
            )
        return gap


def _channel(run: SampledRun, name: str) -> Array:
    if name not in run.inputs:
        raise InputError(f"run {run.name!r} has no channel {name!r}; it has {', '.join(run.inputs)}")
    return run.inputs[name]
