"""Feedback linearization with one side pulling at a time, LQR with integral, reduced-order Kalman filter, guarded loop.

`design_controller` makes a controller from an actuator, its table and its operating map: what it believes. It is run on
a `TruePlant`, of which it knows nothing but the measured position.
"""

from msl_fem.control.believed_plant import BelievedPlant, believed_plant
from msl_fem.control.closed_loop import ClosedLoopRun, TruePlant, run_closed_loop
from msl_fem.control.design import ControllerDesign, FrozenPosition, design_controller, with_measured_gap
from msl_fem.control.frequency_response import FrequencyResponse, frequency_response
from msl_fem.control.recording import closed_loop_record

__all__ = [
    "BelievedPlant",
    "ClosedLoopRun",
    "ControllerDesign",
    "FrequencyResponse",
    "FrozenPosition",
    "TruePlant",
    "believed_plant",
    "closed_loop_record",
    "design_controller",
    "frequency_response",
    "run_closed_loop",
    "with_measured_gap",
]
