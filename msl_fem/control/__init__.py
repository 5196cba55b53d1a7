"""The closed loop: feedback linearization with one side pulling at a time, its rivals, and the guarded loop.

`design_controller` makes the LQR controller from an actuator, its table and its operating map: what it believes;
`designed` makes any of the designs from a `Belief`. A design is run on a `TruePlant`, of which it knows nothing but the
measured position.
"""

from msl_fem.control.belief import Belief, belief_of, reach_of
from msl_fem.control.believed_effects import belief_with_effects
from msl_fem.control.believed_plant import BelievedPlant, believed_plant
from msl_fem.control.bias_design import BiasOptions, BiasPoint, biased_design, default_bias, held_points
from msl_fem.control.closed_loop import ClosedLoopRun, TruePlant, check_stable, run_closed_loop
from msl_fem.control.consistency import Consistency, innovation_consistency
from msl_fem.control.design import KINDS, ControllerDesign, FrozenPosition, with_measured_gap
from msl_fem.control.designs import Choice, designed
from msl_fem.control.examination import Examination, examine
from msl_fem.control.frequency_response import FrequencyResponse, frequency_response
from msl_fem.control.lqr_design import LqrOptions, design_controller, lqr_design
from msl_fem.control.pid_design import pid_design
from msl_fem.control.plant_family import Deviation
from msl_fem.control.rational_force import ForceTerm, IdentifiedPlant, belief_of_terms
from msl_fem.control.recording import closed_loop_record
from msl_fem.control.replay import Replay, replay
from msl_fem.control.robust_design import RobustOptions, robust_design
from msl_fem.control.weight_search import Wish

__all__ = [
    "KINDS",
    "Belief",
    "BelievedPlant",
    "BiasOptions",
    "BiasPoint",
    "Choice",
    "ClosedLoopRun",
    "Consistency",
    "ControllerDesign",
    "Deviation",
    "Examination",
    "ForceTerm",
    "FrequencyResponse",
    "FrozenPosition",
    "IdentifiedPlant",
    "LqrOptions",
    "Replay",
    "RobustOptions",
    "TruePlant",
    "Wish",
    "belief_of",
    "belief_of_terms",
    "belief_with_effects",
    "believed_plant",
    "biased_design",
    "check_stable",
    "closed_loop_record",
    "default_bias",
    "design_controller",
    "designed",
    "examine",
    "frequency_response",
    "held_points",
    "innovation_consistency",
    "lqr_design",
    "pid_design",
    "reach_of",
    "replay",
    "robust_design",
    "run_closed_loop",
    "with_measured_gap",
]
