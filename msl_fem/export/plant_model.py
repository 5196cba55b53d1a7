"""The kernel of the coupled model as C: what the FMU runs is printed from the functions that `simulate` compiles."""

from typing import Any

from msl_fem.export.c_printer import Printer
from msl_fem.export.c_text import c_rows
from msl_fem.export.c_types import FLAG, REAL, WHOLE, Pointer, RecordType, Values
from msl_fem.plant import kernel, layout, preparation, sampled_plant, user_laws
from msl_fem.plant.drive import set_timing
from msl_fem.plant.effects import N_COEFFICIENT, PARAMETER_INDEX, KernelSetting, expressions, set_coefficients
from msl_fem.plant.instruments import N_HISTORY, N_READING, Instruments, hum_frequency, read_sample, set_instruments
from msl_fem.plant.plant import EndStop, PlantParameters
from msl_fem.plant.side import side_gap, side_pull
from msl_fem.plant.step import look_at

HISTORY_DEPTH = 256
"""Samples that are kept of the channels: a reading can be late by two less."""
ROWS = Pointer()
_CELLS = (
    *((name, Pointer(fixed=True)) for name in ("gap", "current", "coefficients")),
    ("n_gap", WHOLE),
    ("n_current", WHOLE),
)
CELLS = RecordType("Cells", _CELLS, (("mutual", None),))
"""Of one magnet's table."""
_MUTUAL_CELLS = RecordType(
    "MutualCells",
    (
        *((name, Pointer(fixed=True)) for name in ("position", "current_1", "current_2", "coefficients")),
        *((name, WHOLE) for name in ("n_position", "n_current_1", "n_current_2", "n_power")),
    ),
)
CELLS_OF_PAIR = RecordType("Cells", (*_CELLS, ("mutual", _MUTUAL_CELLS)))
"""Of the table of a pair."""
END_STOP = RecordType("EndStop", tuple((name, REAL) for name in EndStop._fields), optional=True)
_HISTORY = Pointer((HISTORY_DEPTH, N_HISTORY))
_READ = {"delay": (N_READING,), "polynomial": (N_READING, 4), "drift": (N_READING, 3), "hum": (N_READING, 2)}
INSTRUMENTS = RecordType(
    "Instruments",
    tuple((name, Pointer(_READ[name], fixed=True) if name in _READ else REAL) for name in Instruments._fields),
)
_BUILD = ("sides", "magnets", "current_share", "drive", "polarity")
"""Fields that are decided where the C is printed."""
_FITTED = (
    "leakage_1",
    "leakage_2",
    "mutual",
    "input_gain_1",
    "input_gain_2",
    "input_zero_1",
    "input_zero_2",
    "inductance",
)
"""Fields that no actuator file states."""

_NAMED = (
    "N_STATE", "N_WORK", "N_OUT", "OK", "OUTSIDE_TABLE", "NOT_FINITE", "OUTSIDE_RANGE", "I1", "I2", "X", "V", "SENSOR",
    "ENERGY_ELECTRICAL", "ENERGY_COPPER", "ENERGY_DAMPING", "ENERGY_EXTERNAL", "ENERGY_IMPACT", "AT_CURRENT_LIMIT_1",
    "AT_VOLTAGE_LIMIT_1", "COIL_1", "MEAN_VOLTAGE_1", "STEPS_DONE", "CIRCUIT_2", "INDUCTANCE", "OUT_I1", "OUT_FLUX_1",
    "PADDED",
)  # fmt: skip
"""Names of the layout that fmu_plant.c takes."""


def plant_record(plant: PlantParameters) -> RecordType:
    """The parameters of a plant of that build."""
    known = tuple((name, getattr(plant, name)) for name in (*_BUILD, *_FITTED))
    open_fields = [name for name in PlantParameters._fields if name not in dict(known)]
    return RecordType(
        "PlantParameters", tuple((name, END_STOP if name == "end_stop" else REAL) for name in open_fields), known
    )


def setting_record(plant: RecordType) -> RecordType:
    """What the coefficients of effects depend on beside the effects."""
    return RecordType("KernelSetting", tuple((n, plant if n == "plant" else REAL) for n in KernelSetting._fields))


def plant_source(plant: PlantParameters, *, effects: bool, pair: bool = False) -> dict[str, str]:
    """File name to C: declarations, and the functions of a plant of that build, plain or with every effect; `pair`
    says whether its sides have a table in common."""
    rule, voltages, motion = expressions.law_functions()
    laws = {expressions.set_laws: rule, expressions.voltage_laws: voltages, expressions.motion_laws: motion}
    printer, p = Printer(instead=laws), plant_record(plant)
    for name in _NAMED:
        printer.named(name, getattr(layout, name))
    e: Any = ROWS if effects else None
    cells = CELLS_OF_PAIR if pair else CELLS
    common = {"cells": cells, "p": p, "e": e}
    at = {"j": WHOLE, "current": REAL, "gap": REAL}
    printer.add(layout.begin_at, {"p": p, "state": ROWS, "current_1": REAL, "current_2": REAL, "position": REAL,
                                  "velocity": REAL})  # fmt: skip
    printer.add(set_timing, {"p": p, "e": e, "step": REAL, "work": ROWS})
    printer.add(kernel.advance_rows, common | {"state": ROWS, "work": ROWS, "command": ROWS, "disturbance": REAL,
                                               "step": REAL, "n_step": WHOLE})  # fmt: skip
    rows = {"state": ROWS, "work": ROWS, "row": ROWS, "start": WHOLE, "whole": FLAG}
    printer.add(kernel.write_row, common | rows)
    if plant.sides:
        printer.add(side_gap, {"p": p, "e": e, "work": ROWS, "j": WHOLE})
        printer.add(side_pull, common | {"work": ROWS} | at)
    if effects:
        _add_effects(printer, p, cells)
    arrays = [f"static const double {name}[] = {{\n{c_rows(values)}\n}};\n" for name, values in printer.arrays]
    return {"plant_records.h": printer.declarations, "plant_functions.h": "".join([*arrays, printer.definitions])}


def _add_effects(printer: Printer, p: RecordType, cells: RecordType) -> None:
    """What a run with effects needs beside: coefficients, the start, what the instruments read."""
    setting = setting_record(p)
    sizes = {"N_COEFFICIENT": N_COEFFICIENT, "N_PARAMETER": len(PARAMETER_INDEX), "HISTORY_DEPTH": HISTORY_DEPTH}
    for name, value in {**sizes, "N_HISTORY": N_HISTORY, "N_READING": N_READING}.items():
        printer.named(name, value)
    values = Values(PARAMETER_INDEX)
    printer.add(set_coefficients, {"e": ROWS, "values": values, "setting": setting})
    printer.add(preparation.begin_effects, {"e": ROWS, "state": ROWS})
    printer.add(user_laws.set_added_reading, {"p": p, "e": ROWS, "state": ROWS, "work": ROWS})
    printer.add(look_at, {"e": ROWS, "state": ROWS, "work": ROWS})
    if dict(p.known)["sides"]:
        printer.add(preparation.share_with_iron, {"cells": cells, "p": p, "e": ROWS, "rows": ROWS, "work": ROWS})
    printer.add(set_instruments, {"v": values, "rate": REAL, **{n: Pointer(s) for n, s in _READ.items()}})
    printer.add(hum_frequency, {"v": values})
    printer.add(
        sampled_plant.remember_sample, {"p": p, "effects": ROWS, "state": ROWS, "history": _HISTORY, "k": WHOLE}
    )
    printer.add(read_sample, {"instruments": INSTRUMENTS, "sides": WHOLE, "history": _HISTORY, "k": WHOLE,
                              "noise": ROWS, "readings": ROWS})  # fmt: skip
