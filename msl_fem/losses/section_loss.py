"""The iron losses of a magnet in a periodic operation, section by section, from the flux densities of its table."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError, TableError
from msl_fem.files.quantity import format_quantity
from msl_fem.losses.sheet_loss import FEWEST, FluxWaveform, LossDensity, loss_density
from msl_fem.materials.core_loss_data import Sheet, sheet_of
from msl_fem.table.magnetic_table import SECTION, MagneticTable

if TYPE_CHECKING:
    from scipy.interpolate import RectBivariateSpline

SAMPLES = 256  # of a sine's period: the two routes to <(dB/dt)^2> are 5e-5 apart


REFERENCE_GAP = 0.1  # of the half width: parts do not depend on the gap


def iron_volumes(magnet: MagnetKind) -> dict[str, float]:
    """Part to the volume in m3 of the iron it stands for, sheets only; the sum is the whole magnet."""
    return magnet.section(REFERENCE_GAP * magnet.half_width).iron_volumes


def iron_names(magnet: MagnetKind) -> dict[str, str]:
    """Part to the name of its iron."""
    section = magnet.section(REFERENCE_GAP * magnet.half_width)
    return {part.name: section.iron[part.region][0] for part in section.parts}


class SectionFlux:
    """The signed flux density in the iron of a table's section, a spline over log(gap) and current, odd in the current.

    Raises TableError where the table has no such section or a value of it is not finite.
    """

    def __init__(self, table: MagneticTable, section: str) -> None:
        values = table.extras.get(SECTION + section)
        if values is None:
            raise TableError(
                f"the table holds no flux_density_{section}, so nothing can be said of its loss; "
                f"it has {', '.join(table.sections) or 'no sections'}; make one with 'msl-fem table'"
            )
        if not np.isfinite(values).all():
            m, n = np.argwhere(~np.isfinite(values))[0]
            raise TableError(
                f"flux_density_{section} is not finite at gap {format_quantity(table.gap[m], 'm')}, "
                f"current {table.current[n]:g} A"
            )
        self.table = table
        self.values = values

    @cached_property
    def _spline(self) -> "RectBivariateSpline":
        from scipy.interpolate import RectBivariateSpline

        i = self.table.current
        both_signs = np.r_[-i[:0:-1], i]
        odd = np.hstack([-self.values[:, :0:-1], self.values])
        log_gap = np.log(self.table.gap)
        return RectBivariateSpline(log_gap, both_signs, odd, kx=min(3, log_gap.size - 1), ky=3)

    def __call__(self, current: ArrayLike, gap: ArrayLike) -> Array:
        """T at (current, gap), broadcast together; raises OutOfTable."""
        self.table.evaluate(current, gap)  # its complaint is the table's
        i, g = np.broadcast_arrays(np.asarray(current, dtype=float), np.asarray(gap, dtype=float))
        return np.asarray(self._spline.ev(np.log(g), i))


@dataclass(frozen=True, eq=False)
class PeriodicOperation:
    """One period of a magnet's coil current and gap, in equal steps, the end not repeated.

    Attributes
    ----------
    current, gap : (n_sample,) A, m
    frequency : of the period in Hz
    """

    current: Array
    gap: Array
    frequency: float

    def __post_init__(self) -> None:
        i = np.asarray(self.current, dtype=float)
        g = np.asarray(self.gap, dtype=float)
        if i.ndim != 1 or i.shape != g.shape or i.size < FEWEST:
            raise InputError(
                f"current and gap must be two equally long rows of {FEWEST} samples or more, these have the shapes "
                f"{i.shape} and {g.shape}"
            )

    @property
    def current_rms(self) -> float:
        """A, of the whole period."""
        return float(np.sqrt(np.mean(np.square(self.current))))


def sine_operation(
    current: float, gap: float, *, frequency: float, amplitude: float, gap_amplitude: float = 0.0
) -> PeriodicOperation:
    """current + amplitude sin, gap - gap_amplitude sin: the gap is smallest where the current is largest. A, m, Hz."""
    wave = np.sin(2 * np.pi * np.arange(SAMPLES) / SAMPLES)
    return PeriodicOperation(current + amplitude * wave, gap - gap_amplitude * wave, frequency)


def mean_period(
    time: ArrayLike, current: ArrayLike, gap: ArrayLike, *, frequency: float
) -> tuple[PeriodicOperation, float]:
    """The mean period of a run's last half, and how far its periods are from it.

    Parameters
    ----------
    time, current, gap : (n_sample,) s in equal steps, A of a magnet's coil, m
    frequency : of the period in Hz; a period must be a whole number of samples

    The second value is the RMS of the current's deviations from the mean period over that of its swing.

    Raises
    ------
    InputError : not two whole periods in the last half, no whole number of samples, or a deviation above a quarter:
        the run is not periodic with this frequency
    """
    t, i, g = (np.asarray(a, dtype=float) for a in (time, current, gap))
    if not (np.isfinite(frequency) and frequency > 0):
        raise InputError(f"a frequency of {frequency:g} Hz is not allowed; it must be above 0")
    samples = 1 / (frequency * (t[-1] - t[0]) / (t.size - 1))
    whole = round(samples)
    if whole < FEWEST or abs(samples - whole) > 1e-3 * samples / max(t.size / samples, 1):
        raise InputError(
            f"a period of {frequency:g} Hz has {samples:.5g} samples of this run; it must be a whole number, "
            f"{FEWEST} or more; sample in step with the excitation"
        )
    count = t.size // 2 // whole
    if count < 2:
        raise InputError(
            f"the last half of the run holds {count} whole period(s) of {frequency:g} Hz; give two or more"
        )
    periods = [a[a.size - count * whole :].reshape(count, whole) for a in (i, g)]
    swing = float(np.std(periods[0]))
    apart = float(np.std(periods[0] - periods[0].mean(axis=0))) / swing if swing > 0 else 0.0
    if apart > 0.25:
        raise InputError(
            f"the run is not periodic with {frequency:g} Hz: its periods deviate by {apart:.0%} of its "
            "current's swing; give the frequency of its excitation"
        )
    return PeriodicOperation(periods[0].mean(axis=0), periods[1].mean(axis=0), frequency), apart


@dataclass(frozen=True)
class SectionLoss:
    """The loss of one section's iron.

    Attributes
    ----------
    volume : m3 of iron
    flux_density_min, flux_density_max : T, over the period
    density : W/m3; terms that are not known are None
    sheet : what is known of the iron; its `reason` says why a term is None
    """

    section: str
    sheet: Sheet
    volume: float
    flux_density_min: float
    flux_density_max: float
    density: LossDensity

    @property
    def loss(self) -> float | None:
        """W; None where a term is not known."""
        return None if self.density.total is None else self.volume * self.density.total

    @property
    def swing(self) -> float:
        """T: the whole range of the flux density."""
        return self.flux_density_max - self.flux_density_min

    @property
    def bias(self) -> float:
        """The middle of the flux density's range over its half swing."""
        return abs(self.flux_density_max + self.flux_density_min) / self.swing if self.swing > 0 else 0.0

    @property
    def eddy_loss(self) -> float | None:
        """W of the eddy-current term alone, a lower bound of the loss; None where the sheet is not known."""
        return None if self.density.eddy is None else self.volume * self.density.eddy


@dataclass(frozen=True)
class IronLoss:
    """The iron losses of one magnet."""

    frequency: float
    sections: tuple[SectionLoss, ...]
    notes: tuple[str, ...]

    @property
    def loss(self) -> float | None:
        """W of all sections; None where one is not known."""
        return _sum(section.loss for section in self.sections)

    @property
    def core_loss(self) -> float | None:
        """W of all sections but the armature, which does not heat the winding; None where one is not known."""
        return _sum(section.loss for section in self.sections if section.section != "armature")


def _sum(values: Iterable[float | None]) -> float | None:
    known = list(values)
    return None if None in known else sum(v for v in known if v is not None)


class IronLossModel:
    """The sections of a magnet with their irons and flux densities, ready for any operation within the table.

    Each section's flux density stands for the whole part of the iron (`iron_volumes`), and follows current and gap
    without delay. `thickness` in m takes the place of the sheet's that the iron's data state.
    Raises ActuatorError where the magnet's dimensions are not known, TableError where the table has no section flux
    densities.
    """

    def __init__(self, table: MagneticTable, actuator: Actuator, *, thickness: float | None = None) -> None:
        magnet = actuator.magnet_kind("the iron loss")
        self.volumes = iron_volumes(magnet)
        self.flux = {name: SectionFlux(table, name) for name in self.volumes}
        self.sheets = {name: sheet_of(iron, thickness=thickness) for name, iron in iron_names(magnet).items()}

    def loss(self, operation: PeriodicOperation) -> IronLoss:
        """The losses of one magnet; raises OutOfTable, or InputError as `iron_loss`."""
        sections = [self._section(name, operation) for name in self.volumes]
        return IronLoss(operation.frequency, tuple(sections), _notes(sections))

    def _section(self, name: str, operation: PeriodicOperation) -> SectionLoss:
        b = self.flux[name](operation.current, operation.gap)
        sheet = self.sheets[name]
        density = loss_density(sheet, FluxWaveform(b, operation.frequency))
        return SectionLoss(name, sheet, self.volumes[name], float(b.min()), float(b.max()), density)


def iron_loss(
    table: MagneticTable, actuator: Actuator, *, operation: PeriodicOperation, thickness: float | None = None
) -> IronLoss:
    """The iron losses of one magnet in a periodic operation, from the flux densities of its table: `IronLossModel`.

    Raises
    ------
    ActuatorError : the magnet's dimensions are not known
    OutOfTable, TableError : the operation leaves the table, or the table has no section flux densities
    InputError : a waveform that is not periodic or not resolved, or beyond the measured losses
    """
    return IronLossModel(table, actuator, thickness=thickness).loss(operation)


def _notes(sections: list[SectionLoss]) -> tuple[str, ...]:
    notes = list(dict.fromkeys(s.sheet.reason for s in sections if s.sheet.reason))
    known = [s for s in sections if s.sheet.coefficients is not None]
    for sheet in {s.sheet.iron: s.sheet for s in known}.values():
        c = sheet.coefficients
        assert c is not None
        assert sheet.thickness is not None
        notes.append(
            f"{sheet.iron}, sheets of {sheet.thickness * 1e3:.3g} mm: fit of the measured losses, RMS error "
            f"{c.rms_error:.0%}, largest {c.largest_error:.0%}; source: {c.source}"
        )
    biased = [s.section for s in known if s.bias > 0.1]
    if biased:
        notes.append(
            f"{', '.join(biased)}: the flux density swings about a bias; the hysteresis of such loops is taken as that "
            "of loops about zero, measured ones have more"
        )
    small = [s.section for s in known if s.sheet.coefficients and s.swing < 2 * s.sheet.coefficients.flux_density_min]
    if small:
        notes.append(
            f"{', '.join(small)}: the swing is below the measured ones (0.1 T); the loss goes on as a power of it"
        )
    return tuple(notes)
