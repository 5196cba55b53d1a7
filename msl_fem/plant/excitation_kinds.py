"""The kinds of excitation: their parameters and the signal of each."""

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from msl_fem.actuator import Frequency
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import FrozenModel, In, document
from msl_fem.files.toml_text import quantity_text
from msl_fem.plant.excitation_csv import read_signal
from msl_fem.plant.waveforms import (
    crest_bound,
    faded,
    flat_noise,
    sine,
    single_ramp,
    single_step,
    square,
    swept_sine,
    triangle,
)

Time = Annotated[float, In("s"), Field(gt=0)]
Fade = Annotated[float, In("s"), Field(ge=0)]
Count = Annotated[int, Field(gt=0)]
ExcitedSides = Literal["1", "2", "common", "differential", "independent"]
Unit = Literal["A", "V", "N", "m"]


class Excitation(FrozenModel):
    """What all excitations have.

    Attributes
    ----------
    channel : where the signal goes, see `samples`; None: what is usual for the kind
    amplitude : RMS of noise and multisine, the factor of a file's values, peak of all others
    bias : the constant that the signal is added to, on every side
    duration : of the run
    seed : of the random phases, where there are any
    role : of the run that is made with it
    loop : "closed": a reference that a closed loop follows
    unit : of amplitude and bias: A, V or N of a drive, m of a reference
    """

    name: str
    channel: Annotated[ExcitedSides | None, BeforeValidator(lambda c: str(c) if isinstance(c, int) else c)] = None
    amplitude: Annotated[float, Field(gt=0)]
    bias: float = 0.0
    duration: Time
    seed: Annotated[int, Field(ge=0)] = 0
    role: Literal["fit", "held-out"] = "fit"
    loop: Literal["open", "closed"] = "open"
    unit: Unit = "A"
    usual_channel: ClassVar[ExcitedSides] = "differential"

    @model_validator(mode="before")
    @classmethod
    def _reads_size_in_the_drives_unit(cls, content: dict[str, Any]) -> dict[str, Any]:
        read = dict(content)
        for key in ("amplitude", "bias"):
            if key in read:
                try:
                    read[key] = In(read.get("unit", "A")).read(read[key])
                except ValueError as err:
                    raise ValueError(f"{key}: {err}") from err
        if read.get("unit", "A") == "A" and read.get("bias", 0.0) < 0:
            raise ValueError(
                f"bias: {read['bias']:g} A is below zero; a current's sign makes no force, use 0 A or more"
            )
        return read

    @property
    def spec(self) -> str:
        """The text that reads back to this excitation; a usual `role` (fit) and `loop` (open) are left out."""
        content = document(self)
        content |= {key: quantity_text(content[key], self.unit) for key in ("amplitude", "bias")}
        usual = {"role": "fit", "loop": "open"}
        stated = {
            key: content[key] for key in content if key not in ("name", "unit") and usual.get(key) != content[key]
        }
        return f"{self.name}:" + ",".join(f"{key}={value}" for key, value in stated.items())

    @property
    def highest_frequency(self) -> float:
        """In Hz; 0 where there is none to speak of."""
        return 0.0

    def span(self) -> tuple[float, float]:
        """Lowest and highest value that the signal of unit amplitude can take, whatever the seed."""
        return -1.0, 1.0

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        """The signal of unit amplitude with its first and second derivative in time, (3, n_sample)."""
        raise NotImplementedError


class BandLimitedNoise(Excitation):
    """Noise with a flat spectrum from 0 (excluded) to `band`, nothing above, peaks within 3 RMS.

    Attributes
    ----------
    band : highest frequency in it
    """

    name: Literal["band-limited-noise"]
    band: Frequency
    usual_channel: ClassVar[ExcitedSides] = "independent"

    @property
    def highest_frequency(self) -> float:
        return self.band

    def span(self) -> tuple[float, float]:
        crest = crest_bound(max(1, int(self.band * self.duration * (1 + 1e-12))))
        return -crest, crest

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        count = sample_count(self, rate)
        lines = np.arange(1, int(self.band * count / rate * (1 + 1e-12)) + 1)
        if not lines.size:
            raise InputError(
                f"{self.name}: duration {format_quantity(self.duration, 's')} is shorter than a period of the band's "
                f"{format_quantity(self.band, 'Hz')}; at least {format_quantity(1 / self.band, 's')}"
            )
        return flat_noise(lines, count=count, rate=rate, generator=generator)


class Multisine(Excitation):
    """`periods` equal periods with equal power on harmonics between `start` and `stop`.

    All of them, the odd ones, or the odd ones with detection lines: of four odd harmonics in a row one, by the seed, is
    left out. What a plant answers there, and at even harmonics, is distortion of odd and even order (Pintelon and
    Schoukens, System Identification, 2nd ed., 2012, ch. 4).

    Attributes
    ----------
    start, stop : lowest and highest frequency
    periods : equal ones, in the whole duration
    lines : which harmonics sound
    """

    name: Literal["multisine"]
    start: Frequency
    stop: Frequency
    periods: Count = 4
    lines: Literal["all", "odd", "odd-detection"] = "all"
    usual_channel: ClassVar[ExcitedSides] = "independent"

    @property
    def highest_frequency(self) -> float:
        return self.stop

    def harmonics(self) -> NDArray[np.intp]:
        """The excited multiples of periods/duration; InputError where there are none."""
        period = self.duration / self.periods
        lines = np.arange(int(np.ceil(self.start * period * (1 - 1e-12))), int(self.stop * period * (1 + 1e-12)) + 1)
        lines = lines if self.lines == "all" else lines[lines % 2 == 1]
        lines = np.setdiff1d(lines, self._left_out(lines)) if self.lines == "odd-detection" else lines
        if not lines.size:
            raise InputError(
                f"{self.name}: no multiple of {format_quantity(1 / period, 'Hz')} to excite between start "
                f"{format_quantity(self.start, 'Hz')} and stop {format_quantity(self.stop, 'Hz')}; "
                "lengthen the duration or take fewer periods"
            )
        return lines

    def _left_out(self, odd: NDArray[np.intp]) -> NDArray[np.intp]:
        """One of every four odd harmonics in a row; the last few, where they are fewer, all sound."""
        groups = odd[: odd.size // 4 * 4].reshape(-1, 4)
        chosen = np.random.default_rng([self.seed, 1]).integers(0, 4, groups.shape[0])
        return groups[np.arange(groups.shape[0]), chosen]

    def detection_lines(self) -> NDArray[np.intp]:
        """The odd multiples of periods/duration that are left out, in increasing order; none for other `lines`."""
        if self.lines != "odd-detection":
            return np.zeros(0, dtype=np.intp)
        full = self.model_copy(update={"lines": "odd"}).harmonics()
        return self._left_out(full)

    def span(self) -> tuple[float, float]:
        crest = crest_bound(self.harmonics().size)
        return -crest, crest

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        count = sample_count(self, rate)
        if count % self.periods:
            raise InputError(
                f"{self.name}: {count} samples are not {self.periods} equal periods; "
                "make duration times rate a multiple of periods"
            )
        period = flat_noise(self.harmonics(), count=count // self.periods, rate=rate, generator=generator)
        return np.tile(period, self.periods)


class SweptSine(Excitation):
    """A sine from `start` to `stop`, linear or logarithmic in time, faded in and out (5 % of the duration each).

    Attributes
    ----------
    start, stop : first and last frequency
    law : of the frequency over time
    fade : duration of each fade, in place of the 5 %
    """

    name: Literal["swept-sine"]
    start: Frequency
    stop: Frequency
    law: Literal["linear", "logarithmic"] = "linear"
    fade: Fade | None = None

    @model_validator(mode="after")
    def _fades_leave_a_middle(self) -> "SweptSine":
        if self.fade is not None and self.fade > self.duration / 2:
            raise ValueError(f"fade: {self.fade:g} s is above half the duration, {self.duration / 2:g} s")
        return self

    @property
    def highest_frequency(self) -> float:
        return max(self.start, self.stop)

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        time = instants(self, rate)
        sweep = swept_sine(
            time, frequencies=(self.start, self.stop), duration=self.duration, logarithmic=self.law == "logarithmic"
        )
        fade = 0.05 * self.duration if self.fade is None else self.fade
        return faded(sweep, time, duration=self.duration, fade=fade)


class Sine(Excitation):
    """A sine that starts at zero.

    Attributes
    ----------
    frequency : of the sine
    """

    name: Literal["sine"]
    frequency: Frequency

    @property
    def highest_frequency(self) -> float:
        return self.frequency

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        return sine(instants(self, rate), frequency=self.frequency)


class Step(Excitation):
    """A square wave between plus and minus amplitude; without a frequency one step from 0 after a tenth of the time.

    Attributes
    ----------
    frequency : of the square wave
    """

    name: Literal["step"]
    frequency: Frequency | None = None

    @property
    def highest_frequency(self) -> float:
        return self.frequency or 0.0

    def span(self) -> tuple[float, float]:
        return (-1.0 if self.frequency else 0.0), 1.0

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        time = instants(self, rate)
        if self.frequency is None:
            return single_step(time, delay=0.1 * self.duration)
        return square(time, frequency=self.frequency)


class Ramp(Excitation):
    """A triangular wave between plus and minus amplitude; without a frequency one ramp from 0 to amplitude.

    Attributes
    ----------
    frequency : of the triangular wave
    """

    name: Literal["ramp"]
    frequency: Frequency | None = None

    @property
    def highest_frequency(self) -> float:
        return self.frequency or 0.0

    def span(self) -> tuple[float, float]:
        return (-1.0 if self.frequency else 0.0), 1.0

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        time = instants(self, rate)
        if self.frequency is None:
            return single_ramp(time, duration=self.duration)
        return triangle(time, frequency=self.frequency)


class FromCsv(Excitation):
    """The values of a CSV file's column over its `time_s`, straight between the rows, each times `amplitude`.

    Before its first row and after its last the signal keeps their values.

    Attributes
    ----------
    file : its path; in a TOML file, from the folder of that
    column : which one; needed where several stand beside `time_s`
    duration : if left out, up to the last row
    """

    name: Literal["csv"]
    file: str
    column: str | None = None
    amplitude: Annotated[float, Field(gt=0)] = 1.0
    duration: Time = 0.0

    @model_validator(mode="before")
    @classmethod
    def _lasts_as_long_as_its_file(cls, content: dict[str, Any]) -> dict[str, Any]:
        if not isinstance(content.get("file"), str):
            return content
        time, _ = read_signal(content["file"], content.get("column"))
        return {"duration": float(time[-1]), **content}

    def span(self) -> tuple[float, float]:
        _, values = read_signal(self.file, self.column)
        return float(values.min()), float(values.max())

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        """As of the others; the first derivative is the slope of the line that follows, the second is 0 here."""
        time, values = read_signal(self.file, self.column)
        at = instants(self, rate)
        row = np.searchsorted(time, at, side="right") - 1
        inside = (row >= 0) & (row < time.size - 1)
        slope = np.append(np.diff(values) / np.diff(time), 0.0)
        return np.array([np.interp(at, time, values), np.where(inside, slope[row], 0.0), 0 * at])


KINDS: dict[str, type[Excitation]] = {
    "band-limited-noise": BandLimitedNoise,
    "multisine": Multisine,
    "swept-sine": SweptSine,
    "sine": Sine,
    "step": Step,
    "ramp": Ramp,
    "csv": FromCsv,
}


def sample_count(excitation: Excitation, rate: float) -> int:
    """Number of samples of an excitation at a rate in Hz; at least one."""
    return max(1, round(excitation.duration * rate))


def instants(excitation: Excitation, rate: float) -> Array:
    """Times of the samples in s, (n_sample,), from 0."""
    return np.arange(sample_count(excitation, rate)) / rate
