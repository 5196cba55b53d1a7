"""A current loop about the amplifier of a voltage drive, for controllers, which command currents."""

from msl_fem.actuator import Actuator
from msl_fem.errors import InputError

SLOWER = 10.0
"""A current loop is usually this many times slower than its sampling."""


def with_current_loop(actuator: Actuator, bandwidth: float | None = None) -> Actuator:
    """The actuator with a current loop of a bandwidth (Hz) about its voltage amplifier; another drive as it is.

    A loop that is designed by internal model control is of the first order in closed loop (Harnefors and Nee, IEEE
    Trans. Industry Applications 34(1), 1998, pp. 133 to 141), as the current drive of an actuator file is; the voltage
    limit stays that of the amplifier. By default a tenth of the controller's rate.

    Raises
    ------
    InputError : a bandwidth for a drive that is no voltage drive, or one that is not below half the controller's rate
    """
    drive, controller = actuator.drive, actuator.controller
    if drive is None or drive.kind != "voltage" or controller is None:
        if bandwidth is not None and drive is not None:
            raise InputError(
                f"{actuator.name}: drive.kind is '{drive.kind}', and a current loop is about a voltage amplifier; "
                "state drive.bandwidth in the actuator file instead"
            )
        return actuator
    wanted = controller.rate / SLOWER if bandwidth is None else bandwidth
    if not 0 < wanted < controller.rate / 2:
        raise InputError(
            f"a current loop of {wanted:g} Hz is not between 0 and {controller.rate / 2:g} Hz, half the controller's "
            "rate; take a slower one or raise controller.rate"
        )
    commanded = drive.model_copy(update={"kind": "current", "bandwidth": wanted})
    return actuator.model_copy(update={"drive": commanded})
