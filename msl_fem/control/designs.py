"""The designs by name, with the same wishes for all."""

from dataclasses import dataclass

from msl_fem.control.belief import Belief
from msl_fem.control.bias_design import BiasOptions, biased_design
from msl_fem.control.design import KINDS, ControllerDesign
from msl_fem.control.lqr_design import DEFAULT_WISH, LqrOptions, lqr_design
from msl_fem.control.pid_design import pid_design
from msl_fem.control.robust_design import ROBUST_WISH, RobustOptions, robust_design
from msl_fem.control.weight_search import Wish
from msl_fem.errors import InputError


@dataclass(frozen=True)
class Choice:
    """What a user asks for; what is None is the design's default.

    Attributes
    ----------
    kind : a name of `KINDS`
    bandwidth, peak_sensitivity : Hz, and bound on max |S| in the middle
    feedforward : of lqr and biased
    overlap : N, of all but biased
    bias : A, of biased
    """

    kind: str = "lqr"
    bandwidth: float | None = None
    peak_sensitivity: float | None = None
    feedforward: bool = True
    overlap: float = 0.0
    bias: float | None = None


def designed(belief: Belief, choice: Choice) -> ControllerDesign:
    """The controller of a belief by name and wishes.

    Raises
    ------
    InputError : an unknown design, an option that it has not, a wish that it cannot keep
    """
    if choice.kind not in KINDS:
        raise InputError(f"'{choice.kind}' is no design; choose one of {', '.join(KINDS)}")
    if choice.bias is not None and choice.kind != "biased":
        raise InputError(f"the design {choice.kind} has no bias current; leave the bias out or choose biased")
    if choice.overlap and choice.kind == "biased":
        raise InputError("the design biased has no hand-over between its sides; leave the overlap out")
    if not choice.feedforward and choice.kind in ("robust", "pid"):
        raise InputError(f"the design {choice.kind} comes in one form; a missing feedforward is for lqr and biased")
    usual = ROBUST_WISH if choice.kind == "robust" else DEFAULT_WISH
    wish = Wish(
        usual.bandwidth if choice.bandwidth is None else choice.bandwidth,
        usual.peak_sensitivity if choice.peak_sensitivity is None else choice.peak_sensitivity,
    )
    if choice.kind == "robust":
        return robust_design(belief, wish, options=RobustOptions(overlap=choice.overlap))
    if choice.kind == "biased":
        return biased_design(belief, wish, options=BiasOptions(choice.bias, choice.feedforward))
    if choice.kind == "pid":
        return pid_design(belief, wish, overlap=choice.overlap)
    return lqr_design(belief, wish, options=LqrOptions(choice.feedforward, choice.overlap))
