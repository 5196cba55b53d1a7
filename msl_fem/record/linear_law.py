"""Linear laws that drove a record's runs, as `[[controller.linear]]` of rig.toml states them."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.files.schema import FrozenModel, In, bare_number, first_complaint
from msl_fem.record.columns import CHANNELS

Matrix = tuple[tuple[float, ...], ...]
READINGS = ("position_m", "current_1_A", "current_2_A")
"""Columns that a law may look at."""
OUTPUTS = ("command_1_A", "command_2_A", "current_1_A", "current_2_A", "voltage_1_V", "voltage_2_V", "force_N")
"""Columns that a law may make."""
_NUMBERS = ("a", "b", "c", "d", "signs")  # lists of plain numbers


class _Law(FrozenModel):
    """What both kinds state; `runs` names the runs that it drove (none: all of them)."""

    runs: tuple[str, ...] = ()
    outputs: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)]
    source: str = ""

    @model_validator(mode="after")
    def _makes_what_a_drive_takes(self) -> "_Law":
        for name in self.outputs:
            if name not in OUTPUTS:
                raise ValueError(f"outputs: '{name}' drives nothing; a law makes {', '.join(OUTPUTS)}")
        if len(set(self.outputs)) < len(self.outputs):
            raise ValueError("outputs: a column is there twice; state it once")
        return self


class StateSpaceLaw(_Law):
    """s[k+1] = a s[k] + b y[k], u[k] = c s[k] + d y[k], in SI units, at the controller's rate.

    y are the readings `inputs`, u the commands `outputs`. The reference and constants are left out: of a linear law its
    answer to what is read is all that a simulation beside the record needs.
    """

    kind: Literal["state-space"]
    inputs: Annotated[tuple[str, ...], Field(min_length=1, max_length=3)] = ("position_m",)
    a: Matrix = ()
    b: Matrix = ()
    c: Matrix = ()
    d: Matrix

    @model_validator(mode="after")
    def _fits_together(self) -> "StateSpaceLaw":
        for name in self.inputs:
            if name not in READINGS:
                raise ValueError(f"inputs: '{name}' is not read; a law reads {', '.join(READINGS)}")
        n = len(self.a)
        for name, shape in self._shapes().items():
            rows = getattr(self, name)
            if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
                raise ValueError(
                    f"{name}: is not {shape[0]} rows of {shape[1]} numbers, as {n} states, inputs {list(self.inputs)} "
                    f"and outputs {list(self.outputs)} ask for"
                )
            if not np.isfinite(np.array(rows, dtype=float)).all():
                raise ValueError(f"{name}: a number is not finite")
        return self

    def matrices(self, period: float) -> tuple[Array, Array, Array, Array]:
        """(a, b, c, d) for a law that is run every `period` seconds: as stated."""
        n, n_out = len(self.a), len(self.outputs)
        shapes = {**self._shapes(), "c": (n_out, n)}  # also without states, where the file states no c
        a, b, c, d = (np.array(getattr(self, name), dtype=float).reshape(shapes[name]) for name in "abcd")
        return a, b, c, d

    def _shapes(self) -> dict[str, tuple[int, int]]:
        """Of the matrices as stated."""
        n, n_in, n_out = len(self.a), len(self.inputs), len(self.outputs)
        return {"a": (n, n), "b": (n, n_in), "c": (n_out if n else 0, n), "d": (n_out, n_in)}


class PidLaw(_Law):
    """u = kp e + ki T sum(e) + kd (e - e before)/T of e = reference - position, T the controller's period.

    The sum holds the present error; with `derivative_time` the difference passes a first-order lag of that time. Each
    output takes u times its entry of `signs` (left out: all 1).
    """

    kind: Literal["pid"]
    kp: str
    ki: str | None = None
    kd: str | None = None
    derivative_time: Annotated[float, In("s"), Field(gt=0)] | None = None
    signs: tuple[float, ...] = ()

    @model_validator(mode="after")
    def _gains_are_of_its_output(self) -> "PidLaw":
        self._gains()
        if self.signs and len(self.signs) != len(self.outputs):
            raise ValueError(f"signs: {len(self.signs)} numbers for {len(self.outputs)} outputs; give one each")
        return self

    @property
    def inputs(self) -> tuple[str, ...]:
        return ("position_m",)

    def _gains(self) -> tuple[float, float, float]:
        unit = CHANNELS[self.outputs[0]].unit
        gains = []
        for name, per in (("kp", "/m"), ("ki", "/m/s"), ("kd", " s/m")):
            text = getattr(self, name)
            try:
                gains.append(0.0 if text is None else In(unit + per).read(text))
            except ValueError as err:
                raise ValueError(f"{name}: {err}") from err
        return gains[0], gains[1], gains[2]

    def matrices(self, period: float) -> tuple[Array, Array, Array, Array]:
        """(a, b, c, d) from position to outputs: states are sum of e, e before and its lagged difference, less the
        reference's part."""
        kp, ki, kd = self._gains()
        keep = 0.0 if self.derivative_time is None else float(np.exp(-period / self.derivative_time))
        slope = (1 - keep) * kd / period
        a = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, -slope, keep]])
        b = np.array([[1.0], [1.0], [slope]])
        c = np.array([[ki * period, -slope, keep]])
        d = np.array([[kp + ki * period + slope]])
        signs = np.array(self.signs or (1.0,) * len(self.outputs))[:, None]
        return a, b, -signs * c, -signs * d


StatedLaw = StateSpaceLaw | PidLaw
_KINDS: dict[str, type[StatedLaw]] = {"state-space": StateSpaceLaw, "pid": PidLaw}


def linear_laws(controller: Mapping[str, Any] | None) -> tuple[StatedLaw, ...]:
    """The laws of `[[controller.linear]]`; none where there are none.

    Raises
    ------
    RecordError : an unknown key or kind, matrices that do not fit together, a gain of a wrong unit; names the key path
    """
    stated = (controller or {}).get("linear", [])
    if not isinstance(stated, list | tuple) or not all(isinstance(entry, Mapping) for entry in stated):
        raise RecordError("controller.linear: is no list of laws; write [[controller.linear]] before each")
    return tuple(_linear_law(entry, f"controller.linear.{n}") for n, entry in enumerate(stated))


def _linear_law(entry: Mapping[str, Any], path: str) -> StatedLaw:
    kind = _KINDS.get(str(entry.get("kind")))
    if kind is None:
        raise RecordError(f"{path}.kind: '{entry.get('kind', '')}' is no law; there are {', '.join(_KINDS)}")
    dimensional = {key: value for key, value in entry.items() if key not in _NUMBERS}
    complaint = bare_number(dimensional, (), path=f"{path}.")
    if complaint:
        raise RecordError(complaint)
    try:
        return kind.model_validate(dict(entry))
    except ValidationError as err:
        key, colon, problem = first_complaint(err).partition(": ")
        at = "" if key in ("", "Value error") or not colon else f".{key}"
        raise RecordError(f"{path}{at}: {problem if colon else key}") from err


def law_of(laws: tuple[StatedLaw, ...], run: str) -> StatedLaw | None:
    """The first law that drove a run; None where none is stated."""
    return next((law for law in laws if not law.runs or run in law.runs), None)
