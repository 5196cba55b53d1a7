"""Runs in closed loop of the commands that make records: the controller that is believed in, and its reference."""

from dataclasses import dataclass
from typing import Any

from msl_fem.actuator import Actuator
from msl_fem.control import design_controller
from msl_fem.control.closed_loop import checked_reference
from msl_fem.control.design import ControllerDesign
from msl_fem.control.stepper import Stepper, stated
from msl_fem.errors import InputError
from msl_fem.maps import OperatingMap, operating_map
from msl_fem.plant.excitation import Reference, reference
from msl_fem.plant.excitation_kinds import Excitation
from msl_fem.plant.sampled_plant import clock_of
from msl_fem.table.magnetic_table import MagneticTable


@dataclass(frozen=True, eq=False)
class UsualLoop:
    """The controller of `control` with its default wishes, designed from what is believed.

    Attributes
    ----------
    section : what rig.toml states of it
    """

    design: ControllerDesign
    controller: Stepper
    section: dict[str, Any]

    def reference(self, excitation: Excitation, *, rate: float) -> Reference:
        """The reference of an excitation at `rate` (Hz), which the controller can follow.

        Raises
        ------
        InputError : rates that do not fit; positions or forces outside the believed domain
        """
        wanted = reference(excitation, rate=rate)
        every, _ = clock_of(self.controller, rate=rate)
        at = slice(None, None, every)
        checked_reference(
            self.design,
            Reference(wanted.time[at], wanted.position[at], wanted.velocity[at], wanted.acceleration[at]),
        )
        return wanted


def usual_loop(actuator: Actuator, table: MagneticTable | None, regions: OperatingMap | None = None) -> UsualLoop:
    """The loop that runs excitations with `loop=closed`; `regions` is the guard's map where it is not the table's own.

    Raises
    ------
    InputError : the actuator has no magnet, no controller or no current drive
    """
    if table is None or actuator.controller is None:
        raise InputError(
            f"{actuator.name} has no [magnet] or no [controller]; loop=closed needs both, leave it out for open loop"
        )
    if actuator.drive is None or actuator.drive.kind != "current":
        raise InputError(f'{actuator.name}: loop=closed commands currents; use drive.kind = "current"')
    design = design_controller(actuator, table, regions if regions is not None else operating_map(table))
    section = stated(design)
    if regions is not None:
        del section["design"]  # another map: not to be made again from the record alone
    return UsualLoop(design, Stepper(design), section)
