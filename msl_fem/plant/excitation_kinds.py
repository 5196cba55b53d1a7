"""The kinds of excitation: their parameters and the signal of each, of unit size with two derivatives in time."""

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from msl_fem.actuator import Frequency
from msl_fem.computing.arrays import Array
from msl_fem.errors import ComputationError, InputError
from msl_fem.files.quantity import format_quantity
from msl_fem.files.schema import FrozenModel, In, document
from msl_fem.files.toml_text import quantity_text

LARGEST_CREST = 3.0
_EDGE = 1e-9
"""Share of a period by which rounding may shift a switching instant without moving it to the next sample."""


def sine(time: Array, *, frequency: float) -> Array:
    """sin(2 pi f t): peak 1, starts at 0 and rises."""
    w = 2 * np.pi * frequency
    return np.array([np.sin(w * time), w * np.cos(w * time), -(w**2) * np.sin(w * time)])


def square(time: Array, *, frequency: float) -> Array:
    """A square wave of peak 1 that starts at +1; its derivatives are 0 wherever they exist, and 0 here."""
    half_periods = np.floor(2 * frequency * time + _EDGE)
    return np.array([1 - 2 * (half_periods % 2), 0 * time, 0 * time])


def triangle(time: Array, *, frequency: float) -> Array:
    """A triangular wave of peak 1 that starts at 0 and rises, slope +-4 f; the second derivative is 0 here."""
    phase = (frequency * time + 0.25 + _EDGE) % 1
    return np.array([1 - 4 * np.abs(phase - _EDGE - 0.5), 4 * frequency * np.where(phase < 0.5, 1.0, -1.0), 0 * time])


def single_step(time: Array, *, delay: float) -> Array:
    """0 before `delay`, 1 from there on; the derivatives are 0 here."""
    return np.array([np.where(time >= delay * (1 - _EDGE), 1.0, 0.0), 0 * time, 0 * time])


def single_ramp(time: Array, *, duration: float) -> Array:
    """From 0 at a constant slope, 1 after `duration`."""
    return np.array([time / duration, np.full_like(time, 1 / duration), 0 * time])


def swept_sine(time: Array, *, frequencies: tuple[float, float], duration: float, logarithmic: bool) -> Array:
    """A sine of peak 1 whose frequency runs from the first to the second of `frequencies` within `duration`.

    Its phase is the integral of the frequency, linear f1 + (f2 - f1) t/T or logarithmic f1 (f2/f1)^(t/T), hence
    without a jump (M. Novak et al., "Synchronized swept-sine", J. Audio Eng. Soc. 63, 2015, eq. 2-5).
    """
    f1, f2 = frequencies
    if logarithmic and f1 != f2:
        growth = np.log(f2 / f1) / duration
        frequency = f1 * np.exp(growth * time)
        phase = 2 * np.pi * (frequency - f1) / growth
        chirp = growth * frequency
    else:
        chirp = np.full_like(time, (f2 - f1) / duration)
        frequency = f1 + chirp * time
        phase = 2 * np.pi * (f1 + 0.5 * chirp * time) * time
    w = 2 * np.pi * frequency
    dw = 2 * np.pi * chirp
    return np.array([np.sin(phase), w * np.cos(phase), dw * np.cos(phase) - w**2 * np.sin(phase)])


def faded(signal: Array, time: Array, *, duration: float, fade: float) -> Array:
    """The signal under a window that rises and falls within `fade` as half a cosine (Tukey's), derivatives included."""
    if fade == 0:
        return signal
    left = np.minimum(time, duration - time)
    w = np.pi / fade
    inside = left < fade
    side = np.where(time < duration / 2, 1.0, -1.0)
    window = np.where(inside, 0.5 - 0.5 * np.cos(w * left), 1.0)
    slope = np.where(inside, 0.5 * w * np.sin(w * left) * side, 0.0)
    curve = np.where(inside, 0.5 * w**2 * np.cos(w * left), 0.0)
    s, ds, dds = signal
    return np.array([window * s, slope * s + window * ds, curve * s + 2 * slope * ds + window * dds])


def flat_noise(lines: NDArray[np.intp], *, count: int, rate: float, generator: np.random.Generator) -> Array:
    """One period of `count` samples with equal power on `lines` (multiples of rate/count): RMS 1, bounded peaks.

    Random phases make the noise; where a peak is above 3 RMS (or sqrt(2 n_line), which no sum of so few sines exceeds),
    the signal is clipped and its phases alone are kept, until no peak is (E. Van der Ouderaa et al., "Peak factor
    minimization using a time-frequency domain swapping algorithm", IEEE Trans. Instrum. Meas. 37, 1988). So spectrum
    and RMS are exact, and the distribution is a normal one without its far tails.

    Raises
    ------
    InputError : the highest line is not below half the rate
    ComputationError : no phases were found that keep the peaks down
    """
    if 2 * lines[-1] >= count:
        raise InputError(f"line {lines[-1]} of {count} samples is not below half the rate; lower the highest frequency")
    scale = count / np.sqrt(2 * lines.size)
    bound = crest_bound(lines.size)
    for _ in range(20):
        phase = generator.uniform(0, 2 * np.pi, lines.size)
        for _ in range(100):
            spectrum = np.zeros(count // 2 + 1, complex)
            spectrum[lines] = scale * np.exp(1j * phase)
            signal = np.fft.irfft(spectrum, count)
            if np.abs(signal).max() <= bound:
                w = 2j * np.pi * rate / count * np.arange(spectrum.size)
                return np.array([signal, np.fft.irfft(w * spectrum, count), np.fft.irfft(w**2 * spectrum, count)])
            phase = np.angle(np.fft.rfft(np.clip(signal, -0.95 * bound, 0.95 * bound))[lines])
    raise ComputationError(f"no phases of {lines.size} lines keep the peaks below {bound:g} RMS; take another seed")


def crest_bound(lines: int) -> float:
    """Largest peak over RMS of `flat_noise` with this number of lines."""
    return min(LARGEST_CREST, float(np.sqrt(2 * lines)) * (1 + 1e-12))


Time = Annotated[float, In("s"), Field(gt=0)]
Fade = Annotated[float, In("s"), Field(ge=0)]
Count = Annotated[int, Field(gt=0)]
ExcitedSides = Literal["1", "2", "common", "differential", "independent"]
Unit = Literal["A", "V", "N", "m"]


class Excitation(FrozenModel):
    """What all excitations have; `amplitude` is RMS for noise and multisine, peak otherwise.

    Attributes
    ----------
    channel : where the signal goes, see `samples`; None: what is usual for the kind
    bias : the constant that the signal is added to, on every side
    seed : of the random phases, where there are any
    role, loop : of the run that is made with it, and whether it is a reference that a closed loop follows
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
    """Noise with a flat spectrum from 0 (excluded) to `band`, nothing above, peaks within 3 RMS."""

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
    """A sine from `start` to `stop`, linear or logarithmic in time, faded in and out (5 % of the duration each)."""

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
    """A sine that starts at zero."""

    name: Literal["sine"]
    frequency: Frequency

    @property
    def highest_frequency(self) -> float:
        return self.frequency

    def signal(self, rate: float, generator: np.random.Generator) -> Array:
        return sine(instants(self, rate), frequency=self.frequency)


class Step(Excitation):
    """A square wave between plus and minus amplitude; without a frequency one step from 0 after a tenth of the time."""

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
    """A triangular wave between plus and minus amplitude; without a frequency one ramp from 0 to amplitude."""

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


KINDS: dict[str, type[Excitation]] = {
    "band-limited-noise": BandLimitedNoise,
    "multisine": Multisine,
    "swept-sine": SweptSine,
    "sine": Sine,
    "step": Step,
    "ramp": Ramp,
}


def sample_count(excitation: Excitation, rate: float) -> int:
    """Number of samples of an excitation at a rate in Hz; at least one."""
    return max(1, round(excitation.duration * rate))


def instants(excitation: Excitation, rate: float) -> Array:
    """Times of the samples in s, (n_sample,), from 0."""
    return np.arange(sample_count(excitation, rate)) / rate
