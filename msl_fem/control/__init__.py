"""The closed loop: feedback linearization with one side pulling at a time, its rivals, and the guarded loop.

`design_controller` makes the LQR controller from an actuator, its table and its operating map: what it believes;
`designed` makes any of the designs from a `DesignModel`. A design is run on a `PlantUnderTest`, of
which it knows nothing but the measured position.
"""

from msl_fem.control.baselines import BiasOptions, BiasPoint, biased_design, default_bias, held_points, pid_design
from msl_fem.control.closed_loop import (
    ClosedLoopRun,
    PlantUnderTest,
    check_stable_reach,
    run_closed_loop,
)
from msl_fem.control.design import ControllerChoice, ControllerDesign, FrozenPosition, Wish, with_measured_gap
from msl_fem.control.design_model import (
    DesignModel,
    design_model_as_believed,
    design_model_of,
    design_model_with_effects,
    reach_of,
)
from msl_fem.control.designs import DESIGNS, designed
from msl_fem.control.examination import Consistency, Examination, Replay, examine_design, innovation_consistency, replay
from msl_fem.control.frequency_response import FrequencyResponse, closed_loop_response
from msl_fem.control.linear_plant import LinearPlant, linear_plant
from msl_fem.control.loop_record import closed_loop_record
from msl_fem.control.lqr_design import LqrOptions, design_controller, lqr_design
from msl_fem.control.measured_loop import MeasuredLoop, measured_loops
from msl_fem.control.rational_force import ForceTerm, IdentifiedPlant, design_model_of_terms
from msl_fem.control.robust_design import Deviation, RobustOptions, robust_design

__all__ = [
    "DESIGNS",
    "BiasOptions",
    "BiasPoint",
    "ClosedLoopRun",
    "Consistency",
    "ControllerChoice",
    "ControllerDesign",
    "DesignModel",
    "Deviation",
    "Examination",
    "ForceTerm",
    "FrequencyResponse",
    "FrozenPosition",
    "IdentifiedPlant",
    "LinearPlant",
    "LqrOptions",
    "MeasuredLoop",
    "PlantUnderTest",
    "Replay",
    "RobustOptions",
    "Wish",
    "biased_design",
    "check_stable_reach",
    "closed_loop_record",
    "closed_loop_response",
    "default_bias",
    "design_controller",
    "design_model_as_believed",
    "design_model_of",
    "design_model_of_terms",
    "design_model_with_effects",
    "designed",
    "examine_design",
    "held_points",
    "innovation_consistency",
    "linear_plant",
    "lqr_design",
    "measured_loops",
    "pid_design",
    "reach_of",
    "replay",
    "robust_design",
    "run_closed_loop",
    "with_measured_gap",
]
