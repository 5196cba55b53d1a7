"""Controllers command currents: the wish for the current loop around a voltage drive, as commands take it."""

from dataclasses import replace

from msl_fem.cli.options import read_option
from msl_fem.control.current_loop import with_current_loop
from msl_fem.plant.extended_model import ExtendedModel


def currents_commanded(model: ExtendedModel, bandwidth: str | None) -> ExtendedModel:
    """The model with the wished bandwidth of the current loop around its voltage drive; as it is without a wish.

    Raises
    ------
    InputError : as `with_current_loop`
    QuantityError : a bandwidth without a unit of frequency
    """
    if bandwidth is None:
        return model
    wished = read_option("--current-loop", bandwidth, "Hz")
    return replace(model, actuator=with_current_loop(model.actuator, wished))
