"""The coupled model as a simulator of a record's runs: free runs, Kalman predictions, believed parameters fitted.

Inputs are the record's columns, outputs its readings; where the plant does not run free and the law of its controller
is known, it runs in closed loop. The parameters that are believed within tolerances are fitted by
maximum a posteriori with those tolerances as their prior.
"""

from msl_fem.prediction.believed import BELIEVED, Belief, Plant, believed_plant, free_parameters
from msl_fem.prediction.closed_loop import Asked, closed_run
from msl_fem.prediction.fit import Fitted, RunFit, fit_record
from msl_fem.prediction.free_run import FreeRun, Start, free_run, measured_start, open_loop_stable
from msl_fem.prediction.noise import NoiseFloor, noise_floor
from msl_fem.prediction.prediction import Filtered, ProcessNoise, filtered, k_step, tuned
from msl_fem.prediction.run_data import RunData, run_data

__all__ = [
    "BELIEVED",
    "Asked",
    "Belief",
    "Filtered",
    "Fitted",
    "FreeRun",
    "NoiseFloor",
    "Plant",
    "ProcessNoise",
    "RunData",
    "RunFit",
    "Start",
    "believed_plant",
    "closed_run",
    "filtered",
    "fit_record",
    "free_parameters",
    "free_run",
    "k_step",
    "measured_start",
    "noise_floor",
    "open_loop_stable",
    "run_data",
    "tuned",
]
