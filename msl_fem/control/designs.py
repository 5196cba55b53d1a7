"""The designs by name, with the same wishes for all.

A further design is one file with a `DesignKind`, and its name in `DESIGNS`.
"""

from msl_fem.control.baselines import BIASED, PID
from msl_fem.control.design import ControllerChoice, ControllerDesign, DesignKind, Wish, without_preview
from msl_fem.control.design_model import DesignModel
from msl_fem.control.lqr_design import LQR
from msl_fem.control.robust_design import ROBUST
from msl_fem.control.scheduled_design import SCHEDULED, SCHEDULED_RIGID
from msl_fem.errors import InputError

_KINDS = (LQR, ROBUST, SCHEDULED, SCHEDULED_RIGID, BIASED, PID)
DESIGNS: dict[str, DesignKind] = {kind.name: kind for kind in _KINDS}


def designed(model: DesignModel, choice: ControllerChoice) -> ControllerDesign:
    """The controller for a design model by name and wishes.

    Raises
    ------
    InputError : an unknown design, an option that it has not, a wish that it cannot keep
    """
    if choice.kind not in DESIGNS:
        raise InputError(f"'{choice.kind}' is no design; choose one of {', '.join(DESIGNS)}")
    kind = DESIGNS[choice.kind]
    if choice.bias is not None and "bias" not in kind.options:
        raise InputError(f"the design {kind.name} has no bias current; leave the bias out or choose {_with('bias')}")
    if choice.overlap and "overlap" not in kind.options:
        raise InputError(f"the design {kind.name} has no hand-over between its sides; leave the overlap out")
    if not choice.feedforward and "feedforward" not in kind.options:
        raise InputError(
            f"the design {kind.name} comes in one form; a missing feedforward is for {_with('feedforward')}"
        )
    usual = kind.wish
    wish = Wish(
        usual.bandwidth if choice.bandwidth is None else choice.bandwidth,
        usual.peak_sensitivity if choice.peak_sensitivity is None else choice.peak_sensitivity,
    )
    design = kind.build(model, wish, choice)
    return design if choice.preview else without_preview(design)


def _with(option: str) -> str:
    """The designs that have an option."""
    return " and ".join(kind.name for kind in DESIGNS.values() if option in kind.options)
