"""A designed controller as one C99 header: estimator, law, force to currents, guard; equal to the compiled Python."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from msl_fem.control import controller
from msl_fem.control.controller import ControllerParameters, causal_step, controller_state, controller_step
from msl_fem.control.design import ControllerDesign
from msl_fem.control.output_stage import BIAS
from msl_fem.control.stepper import reference_rows
from msl_fem.export.c_current_loop import current_loop_content, print_current_loop
from msl_fem.export.c_guard import guard_header, guard_names
from msl_fem.export.c_printer import Printer, header_style
from msl_fem.export.c_table import table_functions
from msl_fem.export.c_text import c_header, c_prefix, write_header
from msl_fem.export.c_types import REAL, Pointer
from msl_fem.maps import OperatingMap
from msl_fem.plant.plant import Surface
from msl_fem.table.coenergy_surface import CoenergySurface
from msl_fem.table.magnetic_table import INTERPOLANT

Array = NDArray[np.float64]
_CHECKED = 64
_CELLS_CHECKED = 5
_ROWS = (
    "INNOVATION", "FORCE", "N_PREFERRED", "N_DISCOURAGED", "N_FORCE_LIMITED", "N_HEAT_LIMITED", "N_VIOLATION", "RISE_1",
    "RISE_2", "COMING",
)  # fmt: skip
"""Of the controller's state, what the header tells."""


@dataclass(frozen=True, eq=False)
class ControllerSource:
    """A controller to be exported, and the operating map that its guard judges by.

    `learned` are the rows (n, 6) of a periodic reference as it was learned, where one was.
    """

    design: ControllerDesign
    regions: OperatingMap
    learned: Array | None = None


def controller_header(source: ControllerSource, *, name: str | None = None) -> str:
    """The text of the header: surface, guard, controller, and steps to check a compiler and a machine by.

    Raises
    ------
    InputError : a `name` that cannot begin C names
    """
    design, belief = source.design, source.design.actuator
    parameters, plant = design.parameters, design.law.plant
    prefix = c_prefix(belief.name, name)
    inverse, biased = parameters.inverse, parameters.stage.kind == BIAS
    two = inverse.surface_1 is not inverse.surface_2
    alone = biased and design.current_loop is None  # about a bias no force is inverted
    surfaces = [] if alone else [(inverse.surface_1, prefix)]
    surfaces += [(inverse.surface_2, f"{prefix}_2")] if two and not alone else []
    printer = controller_printer(parameters, prefix, surfaces)
    if design.current_loop is not None:
        print_current_loop(printer, design.current_loop)
    return c_header(
        "controller.h.j2",
        prefix,
        {
            "actuator": belief.name,
            "digest": belief.digest,
            "law": f"{design.kind}: {design.summary}",
            "rate": 1.0 / plant.period,
            "delay": int(parameters.delay),
            "lead": float(parameters.lead),
            "reach": design.reach,
            "doubles": controller_state(parameters).size,
            "parts": "\n".join(
                [
                    *(_surface_text(surface, name, design) for surface, name in surfaces),
                    guard_header(source.regions, name=prefix),
                ]
            ),
            "arrays": printer.arrays,
            "printed": f"{printer.declarations}\n{printer.definitions}",
            "row": {name: getattr(controller, name) for name in _ROWS},
            "check": check_steps(design),
            "learned": source.learned,
            "inner": current_loop_content(design.current_loop),
        },
    )


def controller_printer(parameters: ControllerParameters, prefix: str, surfaces: list[tuple[Surface, str]]) -> Printer:
    """The step of a controller as C, its numbers known; surfaces and guard stand in the header under their names."""
    names = list(guard_names(parameters.inverse.guard, prefix))
    for surface, own in surfaces:
        fields = zip(("gap", "current", "coenergy"), surface[:3], strict=True)
        names += [(id(values), f"{own}_table_{field}_") for field, values in fields]
    style = header_style(f"{prefix}_controller_", exact=prefix, unrolled=frozenset({"side"}), arrays=tuple(names))
    printer = Printer(style)
    rows = {"state": Pointer((controller_state(parameters).size,)), "command": Pointer((2,))}
    given = {"parameters": parameters, "measured": REAL} | rows
    printer.add(controller_step, given | {"reference": Pointer((6,))})
    printer.add(causal_step, given | {"reference": Pointer((3,))})
    return printer


def write(source: ControllerSource, target: Path, *, name: str | None = None) -> tuple[Path, ...]:
    """The header written. Raises InputError as `controller_header`, or where the folder cannot be written."""
    return write_header(controller_header(source, name=name), target)


def check_steps(design: ControllerDesign) -> dict[str, Array]:
    """References (n, 6), readings (n,) and the compiled controller's commands (n, 2): in reach, and far beyond it.

    In every second step the reference is not known ahead.
    """
    low, high = design.reach
    period = design.law.plant.period
    k = np.arange(_CHECKED)
    w = 2 * np.pi / (_CHECKED / 2 * period)
    swing, middle = 0.5 * (high - low), 0.5 * (high + low)
    phase = w * k * period
    wanted = np.column_stack([
        middle + swing * np.sin(phase), swing * w * np.cos(phase), -swing * w**2 * np.sin(phase),
    ])  # fmt: skip
    measured = middle + swing * (np.sin(phase - 0.4) + 0.02 * np.sin(7.3 * phase))
    measured[_CHECKED // 2 :] *= np.linspace(1.0, 1.5, _CHECKED - _CHECKED // 2)
    rows = reference_rows(design, wanted, period=period)
    state, command = controller_state(design.parameters), np.zeros((_CHECKED, 2))
    for n in range(_CHECKED):
        step = causal_step if n % 2 else controller_step
        step(design.parameters, state, rows[n], float(measured[n]), command[n])
    return {"reference": rows, "measured": measured, "command": command}


def _surface_text(surface: Surface, prefix: str, design: ControllerDesign) -> str:
    """The header of a surface that the controller inverts."""
    evaluated = CoenergySurface(*surface[:3])
    gap, current = (
        np.r_[nodes[np.linspace(0, nodes.size - 1, _CELLS_CHECKED).astype(int)], nodes[:2].mean(), np.nan]
        for nodes in (surface.gap, surface.current)
    )
    i, g = (values.ravel() for values in np.meshgrid(current, gap))
    content = {
        "actuator": design.actuator.name,
        "digest": design.actuator.digest,
        "interpolant": INTERPOLANT,
        "errors": {},
        "gap": surface.gap,
        "current": surface.current,
        "coefficients": surface.coefficients,
        "printed": table_functions(evaluated, prefix),
        "check": {"current": i, "gap": g, "values": evaluated(i, g).T},
    }
    return c_header("table.h.j2", prefix, content)
