"""The coupled model as a simulator of a record's runs: free runs, Kalman predictions, believed parameters fitted.

Inputs are the record's columns, outputs its readings; where the plant does not run free and the law of its controller
is known, it runs in closed loop. The parameters that are believed within tolerances are fitted by
maximum a posteriori with those tolerances as their prior.
"""

from msl_fem.prediction.fit import FittedParameter, RecordFit, fit_record
from msl_fem.prediction.free_run import (
    CallableLaw,
    FreeRun,
    Start,
    closed_run,
    free_run,
    measured_start,
    open_loop_stable,
)
from msl_fem.prediction.hypothesis import BELIEVED, KernelPlant, ModelHypothesis, free_parameters, kernel_plant
from msl_fem.prediction.kalman import KalmanFilterRun, ProcessNoise, k_step, kalman_filter, tuned_process_noise
from msl_fem.prediction.run_data import NoiseFloor, RunData, noise_floor, run_data

__all__ = [
    "BELIEVED",
    "CallableLaw",
    "FittedParameter",
    "FreeRun",
    "KalmanFilterRun",
    "KernelPlant",
    "ModelHypothesis",
    "NoiseFloor",
    "ProcessNoise",
    "RecordFit",
    "RunData",
    "Start",
    "closed_run",
    "fit_record",
    "free_parameters",
    "free_run",
    "k_step",
    "kalman_filter",
    "kernel_plant",
    "measured_start",
    "noise_floor",
    "open_loop_stable",
    "run_data",
    "tuned_process_noise",
]
