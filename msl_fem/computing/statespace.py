"""A linear time-invariant system in state space, continuous or sampled."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError

_KEPT = 4  # responses


@dataclass(frozen=True, eq=False)
class StateSpace:
    """dx/dt = A x + B u, y = C x + D u; with a sampling period x[k+1] = A x[k] + B u[k].

    Attributes
    ----------
    A, B, C, D : (n_state, n_state), (n_state, n_input), (n_output, n_state), (n_output, n_input)
    sampling_period : s; None for continuous time
    states, inputs, outputs : names with as many entries as there are, or none
    """

    A: Array
    B: Array
    C: Array
    D: Array
    sampling_period: float | None = None
    states: tuple[str, ...] = ()
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in "ABCD":
            object.__setattr__(self, name, np.atleast_2d(np.asarray(getattr(self, name), dtype=float)))
        n, m, p = self.A.shape[0], self.B.shape[1], self.C.shape[0]
        wanted = {"A": (n, n), "B": (n, m), "C": (p, n), "D": (p, m)}
        for name, shape in wanted.items():
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"{name} has the shape {getattr(self, name).shape}, with the others it must be {shape}"
                )
        for kind, names, size in (("states", self.states, n), ("inputs", self.inputs, m), ("outputs", self.outputs, p)):
            if names and len(names) != size:
                raise InputError(f"{len(names)} names of {kind} for {size}; name all or none")
        if self.sampling_period is not None and not self.sampling_period > 0:
            raise InputError(
                f"sampling_period {self.sampling_period:g} s must be positive, or None for continuous time"
            )

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Eigenvalues of A, in 1/s for continuous time, (n_state,)."""
        return np.linalg.eigvals(self.A).astype(complex)

    @property
    def is_stable(self) -> bool:
        """All poles in the open left half plane, or inside the unit circle."""
        if self.sampling_period is None:
            return bool((self.poles.real < 0).all())
        return bool((np.abs(self.poles) < 1).all())

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """C (q I - A)^-1 B + D at frequencies in Hz (n_frequency,): (n_frequency, n_output, n_input).

        q = j w in continuous time, exp(j w T) with a sampling period T. Read-only: that of the last few sets of
        frequencies is kept, for a design asks the same system again and again.
        """
        f = np.atleast_1d(np.asarray(frequency, dtype=float))
        key = f.tobytes()
        if key not in self._responses:
            if len(self._responses) >= _KEPT:
                self._responses.clear()
            self._responses[key] = self._response(f)
            self._responses[key].flags.writeable = False
        return self._responses[key]

    @cached_property
    def _responses(self) -> dict[bytes, NDArray[np.complex128]]:
        return {}

    def _response(self, frequency: Array) -> NDArray[np.complex128]:
        jw = 2j * np.pi * frequency
        q = np.asarray(jw if self.sampling_period is None else np.exp(jw * self.sampling_period), dtype=complex)
        return np.asarray(self.C @ states_over_inputs(self.A, self.B, q) + self.D)

    def sampled(self, period: float) -> "StateSpace":
        """The system that a computer sees through a zero-order hold: exact at the sampling instants.

        Raises
        ------
        InputError : the system is sampled already
        """
        if self.sampling_period is not None:
            raise InputError(
                f"the system is sampled already, with {self.sampling_period:g} s; start from continuous time"
            )
        from scipy.signal import cont2discrete  # here, for its import costs a second

        a, b, c, d, _ = cont2discrete((self.A, self.B, self.C, self.D), period, method="zoh")
        return StateSpace(a, b, c, d, float(period), self.states, self.inputs, self.outputs)


def states_over_inputs(A: Array, B: Array, q: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """(n_q, n_state, n_input) (q I - A)^-1 B at each q (n_q,)."""
    shifted = np.tile(-A.astype(complex), (q.size, 1, 1))
    diagonal = np.arange(len(A))
    shifted[:, diagonal, diagonal] += q[:, None]
    return np.linalg.solve(shifted, B.astype(complex)[None])
