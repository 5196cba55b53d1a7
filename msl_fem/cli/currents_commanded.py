"""Controllers command currents: what commands do with the file of a voltage drive."""

from dataclasses import replace

from msl_fem.cli.options import read_option
from msl_fem.cli.output import say
from msl_fem.control.current_loop import with_current_loop
from msl_fem.plant.extended_model import ExtendedModel


def currents_commanded(model: ExtendedModel, bandwidth: str | None) -> ExtendedModel:
    """The model with a current loop about the amplifier of a voltage drive, and a line that says so.

    Raises
    ------
    InputError : as `with_current_loop`
    QuantityError : a bandwidth without a unit of frequency
    """
    wanted = None if bandwidth is None else read_option("--current-loop", bandwidth, "Hz")
    actuator = with_current_loop(model.actuator, wanted)
    if actuator is model.actuator:
        return model
    assert actuator.drive is not None
    said = f"a current loop of {actuator.drive.bandwidth:g} Hz is taken about it"
    say(f"note: {actuator.name} has a voltage drive: {said}")
    return replace(model, actuator=actuator)
