"""A quasi-static map of one magnet on the bench: the current goes up and down at one gap after the other."""

import numpy as np

from msl_fem.bench.magnet import series_current, side_magnet
from msl_fem.bench.plant import Array, Bench, Plant, as_record
from msl_fem.bench.preisach import pinned_current, settle, virgin_memory
from msl_fem.bench.rig import Rig, surface_of
from msl_fem.bench.setting import Setting
from msl_fem.computing.compiled import compiled
from msl_fem.errors import InputError
from msl_fem.record import StaticMap

FORCE_NOISE, FLUX_NOISE = 0.2, 2e-5
"""N and Wb, one sigma of the map's instruments."""
_GAPS, _CURRENTS, _SETTLING = 7, 13, 8


def static_map(setting: Setting, rig: Rig, generator: np.random.Generator, *, noisy: bool = True) -> StaticMap:
    """The map over gaps as read and currents as read, up and down, with the magnet demagnetised before every gap.

    The gaps span four fifths of the range as far as the believed table reaches, the currents half of the largest: what
    is asked for tells nothing of what is true.

    Raises
    ------
    InputError : the rig has no magnets
    """
    actuator, table = setting.actuator, setting.table
    if rig.table is None or table is None or actuator.motion is None:
        raise InputError(f"{rig.name}: a static map needs magnets; leave out --static")
    plant = _one_magnet(rig)
    nominal = float(actuator.motion.nominal_gap or 0.0)
    off = rig.plant.magnets.nominal_gap - nominal  # true less read
    reach = 0.8 * rig.plant.motion.travel
    low, high = max(nominal - reach, 1.3 * table.gap[0]), min(nominal + reach, 0.9 * table.gap[-1])
    top = 0.5 * min(float(table.current[-1]), rig.plant.circuit.current_limit * rig.plant.magnets.share)
    up = np.linspace(0.0, top, _CURRENTS)
    ramp, direction = np.r_[up, up[-2::-1]], np.r_[np.full(_CURRENTS, "up"), np.full(_CURRENTS - 1, "down")]
    bench = Bench(as_record(plant), surface_of(rig.table), np.zeros((2, 1)), np.zeros((2, 1)), np.zeros((2, 2)))
    rows = []
    for number, gap in enumerate(np.linspace(low, high, _GAPS)):
        found = np.zeros((ramp.size, 2))
        true_current = (ramp - rig.instruments.current_offset) / rig.instruments.current_gain
        if not _ramp(bench, virgin_memory(), true_current, gap + off, found):
            raise InputError(f"{rig.name}: the static map leaves the table at {gap * 1e3:.3g} mm; leave out --static")
        rows.append(np.column_stack([np.full(ramp.size, gap), ramp, found, np.full(ramp.size, number)]))
    gap, current, force, flux, sequence = np.concatenate(rows).T
    noise = generator.standard_normal((2, force.size)) if noisy else np.zeros((2, force.size))
    return StaticMap(
        gap=gap,
        current=current,
        force=force + FORCE_NOISE * noise[0],
        flux_linkage=flux + FLUX_NOISE * noise[1],
        role=np.where(sequence % 3 == 1, "held-out", "fit"),
        direction=np.tile(direction, _GAPS),
        sequence=sequence,
    )


def _one_magnet(rig: Rig) -> Plant:
    """The plant of a rig with one magnet on one side, whose effects are those of a side's share."""
    plant, m = rig.plant, rig.plant.magnets
    per_flux, per_current = (
        m.per_side * m.share,
        m.share,
    )  # side's flux over a magnet's, magnet's current over the side's
    h, iron = plant.hysteresis, plant.series_iron
    return plant._replace(
        magnets=m._replace(sides=1, per_side=1, share=1.0),
        hysteresis=h._replace(amplitude=h.amplitude * per_current, flux_scale=h.flux_scale / per_flux),
        series_iron=iron._replace(
            step=iron.step / per_flux, value=iron.value * per_current, slope=iron.slope * per_current * per_flux
        ),
    )


@compiled
def _ramp(bench: Bench, memory: Array, currents: Array, gap: float, found: Array) -> bool:
    """Force and flux linkage (n, 2) along a ramp of coil currents (n,); False outside the table."""
    magnetising = 0.0
    for n in range(currents.size):
        # bisection for i_m: the coil's current grows with it
        low, high = magnetising - 0.5 * (abs(currents[n]) + 1.0), currents[n] + 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            inside, _, current = _coil_current(bench, memory, middle, gap, found[n])
            if not inside:
                return False
            if current < currents[n]:
                low = middle
            else:
                high = middle
        magnetising = 0.5 * (low + high)
        _coil_current(bench, memory, magnetising, gap, found[n])
        settle(bench.plant.hysteresis, memory, found[n, 1])
    return True


@compiled
def _coil_current(bench: Bench, memory: Array, magnetising: float, gap: float, row: Array) -> tuple[bool, float, float]:
    """(inside the table, flux linkage, coil current); force and flux linkage into the row."""
    inside, flux, force, _, _ = side_magnet(bench.surface, bench.plant.magnets, magnetising, gap)
    if not inside:
        return False, flux, 0.0
    row[0], row[1] = force, flux
    current = magnetising
    if bench.plant.series_iron.step > 0.0:
        current += series_current(bench.plant.series_iron, flux)
    if bench.plant.hysteresis.amplitude > 0.0:
        current += pinned_current(bench.plant.hysteresis, memory, flux)
    return True, flux, current
