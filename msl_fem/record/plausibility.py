"""Whether a run's numbers are a machine's: beyond any sensor is refused; a sensor against its command, voltage and
current, and columns that say of one another that they were not measured, are doubted."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import RecordError
from msl_fem.record.columns import CHANNELS, UNITS, Channel, Quantity, place
from msl_fem.record.doubts import affine_copies, coarse, looked_up, resistance_told, too_slow
from msl_fem.record.label_doubts import doubtful_table
from msl_fem.record.record import Run, StaticMap

LARGEST: dict[Quantity, float] = {
    "position": 100.0, "reference": 100.0, "force": 1e9, "temperature": 1e4, "voltage": 1e7, "current": 1e6,
    "command": 1e6, "flux_linkage": 1e6, "velocity": 1e4,
}  # fmt: skip
"""In SI units: more than any machine of this kind has, whatever it is."""
STATIC: dict[str, Quantity] = {
    "gap_m": "position", "current_A": "current", "force_N": "force", "flux_linkage_Wb": "flux_linkage",
}  # fmt: skip
"""Columns of a static map and what they are."""
ASKED = 0.2
"""Share of the command that a dead sensor misses at least, in the mean."""
MEASURED: tuple[Quantity, ...] = ("position", "velocity", "current", "voltage", "force", "flux_linkage", "temperature")
OF_A_COPY = 1e-6
"""Of a velocity's span, within which it is what differences of the positions are."""
OF_TWICE = 2.5
"""Factor by which the resistance that voltage and current tell may differ from the stated one: a connection is 2."""
APART = 20.0
"""Factor by which a current that follows its command is never larger or smaller; a wrong unit is 1000."""


def refuse_impossible(columns: Mapping[str, Array], *, file: Path | str) -> None:
    """RecordError naming the first sample, of a run or a static map, beyond what any machine shows."""
    for name, values in columns.items():
        quantity = CHANNELS[name].quantity if name in CHANNELS else STATIC.get(name)
        if quantity not in LARGEST:
            continue
        most, unit = LARGEST[quantity], UNITS[quantity]
        beyond = np.flatnonzero(np.abs(values) > most)
        if beyond.size:
            at = int(beyond[0])
            raise RecordError(
                f"{place(file, at)}, column {name}: {values[at]:g} {unit} is more than any machine shows, {most:g} "
                f"{unit}; look at the unit of this column"
            )


def doubtful_against_command(run: Run, *, file: Path | str) -> list[str]:
    """One warning for each current that stands still where another one is asked, or is of another size than asked."""
    warnings = []
    for side in (1, 2):
        current = run.columns.get(Channel("current", side).column)
        command = run.columns.get(Channel("command", side).column)
        if current is None or command is None or current.size == 0:
            continue
        asked, there = (float(np.sqrt(np.mean(v**2))) for v in (command, current))
        missed = float(np.mean(np.abs(command - current)))
        name = Channel("current", side).column
        if np.ptp(current) == 0 and missed > ASKED * asked > 0:
            warnings.append(
                f"{file}: {name} stands at {current[0]:g} A throughout while {asked:.3g} A are commanded; is the "
                "sensor connected?"
            )
        elif asked > 0 and there > 0 and not 1 / APART < there / asked < APART:
            warnings.append(
                f"{file}: {name} is {there:.3g} A (RMS) while {asked:.3g} A are commanded; is one of them in another "
                "unit?"
            )
    return warnings


def doubtful_channels(run: Run, actuator: Actuator, *, file: Path | str) -> list[str]:
    """Warnings where measured columns of a run are copies or look-ups of one another, too coarse or too slow, or where
    voltage and current of a side cannot both be true."""
    measured = {name: v for name, v in run.columns.items() if CHANNELS[name].quantity in MEASURED}
    if run.time.size < 2:
        return []
    live = ("position", "flux_linkage") if run.mover != "locked" else ("flux_linkage",)
    sensors = {name: v for name, v in measured.items() if CHANNELS[name].quantity in live}
    doubts = [*affine_copies(measured), *looked_up(measured), *coarse(sensors)]
    doubts += too_slow({name: v for name, v in sensors.items() if name == "position_m"})
    doubts += _differentiated(run)
    for side in (1, 2):
        doubts += _coil_doubts(run, actuator, side)
    return [f"{file}: {doubt}" for doubt in doubts]


def _differentiated(run: Run) -> list[str]:
    """Whether a velocity was made of the positions and not measured."""
    position, velocity = run.columns.get("position_m"), run.columns.get("velocity_m_per_s")
    if position is None or velocity is None or run.time.size < 4:
        return []
    step = np.diff(position) / run.sampling_period
    made = {"forward": step[1:], "backward": step[:-1], "central": (step[1:] + step[:-1]) / 2}
    for name, values in made.items():
        if np.abs(velocity[1:-1] - values).max() <= OF_A_COPY * np.ptp(velocity):
            return [
                f"velocity_m_per_s is the {name} difference of position_m in every row: no measurement of its own; "
                "leave it out"
            ]
    return []


def _coil_doubts(run: Run, actuator: Actuator, side: int) -> list[str]:
    """Whether voltage and current of a side tell a resistance that is far from the stated one, or below 0."""
    names = Channel("voltage", side).column, Channel("current", side).column
    stated = _side_resistance(actuator)
    if not stated or not set(names) <= set(run.columns):
        return []
    told = resistance_told(run[names[0]], run[names[1]], run.sampling_period)
    if told is None or stated / OF_TWICE <= told <= stated * OF_TWICE:
        return []
    return [
        f"{names[0]} and {names[1]} cannot both be true: together they tell a resistance of {told:.3g} ohm where "
        f"{stated:.3g} ohm is stated; look at signs and units"
    ]


def _side_resistance(actuator: Actuator) -> float | None:
    """Ohm of a side's coils as [drive] states them; None where it does not."""
    stated = actuator.drive.coil_resistance if actuator.drive is not None else None
    if stated is None or actuator.sides is None:
        return stated
    magnets = actuator.sides.magnets_per_side
    return stated * magnets if actuator.sides.connection == "series" else stated / magnets


def doubtful_map(static: StaticMap, *, file: Path | str) -> list[str]:
    """Warnings where a static map's readings contradict its labels."""
    labels = {"gap_m": static.gap, "current_A": static.current}
    readings = {"force_N": static.force, "flux_linkage_Wb": static.flux_linkage}
    measured = {name: v for name, v in readings.items() if v is not None and np.isfinite(v).all()}
    doubts = [*affine_copies(measured), *doubtful_table(labels, measured)]
    return [f"{file}: {doubt}" for doubt in doubts]
