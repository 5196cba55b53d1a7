"""The linear law of a closed loop, as `[[controller.linear]]` of rig.toml states it."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, ValidationError, model_validator

from msl_fem.errors import RecordError
from msl_fem.files.schema import FrozenModel, In, bare_number, first_complaint

Array = NDArray[np.float64]
Matrix = tuple[tuple[float, ...], ...]
READINGS = ("position_m", "current_1_A", "current_2_A")
"""Columns that a law may look at."""
OUTPUT_UNIT = {
    "command_1_A": "A", "command_2_A": "A", "current_1_A": "A", "current_2_A": "A", "voltage_1_V": "V",
    "voltage_2_V": "V", "force_N": "N",
}  # fmt: skip
"""Columns that a law may make, with their units."""
_NUMBERS = ("a", "b", "c", "d", "signs")  # lists of plain numbers


class _Law(FrozenModel):
    """What both kinds state; `runs` names the runs that it drove (none: all of them)."""

    runs: tuple[str, ...] = ()
    outputs: Annotated[tuple[str, ...], Field(min_length=1, max_length=2)]
    source: str = ""

    @model_validator(mode="after")
    def _makes_what_a_drive_takes(self) -> "_Law":
        for name in self.outputs:
            if name not in OUTPUT_UNIT:
                raise ValueError(f"outputs: '{name}' drives nothing; a law makes {', '.join(OUTPUT_UNIT)}")
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
        n, n_in, n_out = len(self.a), len(self.inputs), len(self.outputs)
        wanted = {"a": (n, n), "b": (n, n_in), "c": (n_out if n else 0, n), "d": (n_out, n_in)}
        for name, shape in wanted.items():
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
        n, n_in, n_out = len(self.a), len(self.inputs), len(self.outputs)
        shapes = ((n, n), (n, n_in), (n_out, n), (n_out, n_in))
        a, b, c, d = (
            np.array(rows, dtype=float).reshape(shape)
            for rows, shape in zip((self.a, self.b, self.c, self.d), shapes, strict=True)
        )
        return a, b, c, d


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
        unit = OUTPUT_UNIT[self.outputs[0]]
        found = []
        for name, per in (("kp", "/m"), ("ki", "/m/s"), ("kd", " s/m")):
            text = getattr(self, name)
            try:
                found.append(0.0 if text is None else In(unit + per).read(text))
            except ValueError as err:
                raise ValueError(f"{name}: {err}") from err
        return found[0], found[1], found[2]

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


LinearLaw = StateSpaceLaw | PidLaw
_KINDS: dict[str, type[LinearLaw]] = {"state-space": StateSpaceLaw, "pid": PidLaw}


def linear_laws(controller: Mapping[str, Any] | None) -> tuple[LinearLaw, ...]:
    """The laws of `[[controller.linear]]`; none where there are none.

    Raises
    ------
    RecordError : an unknown key or kind, matrices that do not fit together, a gain of a wrong unit; names the key path
    """
    stated = (controller or {}).get("linear", [])
    if not isinstance(stated, list | tuple) or not all(isinstance(one, Mapping) for one in stated):
        raise RecordError("controller.linear: is no list of laws; write [[controller.linear]] before each")
    found = []
    for n, one in enumerate(stated):
        where = f"controller.linear.{n}"
        kind = _KINDS.get(str(one.get("kind")))
        if kind is None:
            raise RecordError(f"{where}.kind: '{one.get('kind', '')}' is no law; there are {', '.join(_KINDS)}")
        complaint = bare_number({key: one[key] for key in one if key not in _NUMBERS}, (), path=f"{where}.")
        if complaint:
            raise RecordError(complaint)
        try:
            found.append(kind.model_validate(dict(one)))
        except ValidationError as err:
            path, colon, said = first_complaint(err).partition(": ")
            at = "" if path in ("", "Value error") or not colon else f".{path}"
            raise RecordError(f"{where}{at}: {said if colon else path}") from err
    return tuple(found)


def law_of(laws: tuple[LinearLaw, ...], run: str) -> LinearLaw | None:
    """The first law that drove a run; None where none is stated."""
    return next((law for law in laws if not law.runs or run in law.runs), None)
