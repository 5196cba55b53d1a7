"""The compiled loops of the extended Kalman predictor in innovation form, and of predictions some samples ahead.

State x of the kernel (some of its rows), readings y. From the state that is known at a sample the kernel's `advance`
gives both at the next one, and differences through it give G = d(x, y)/dx. With the joint covariance G P G' + noise, a
reading is one entry of (x, y) that becomes known: conditioning on the readings one by one is the measurement update
(Anderson and Moore, Optimal Filtering, 1979, sec. 6.4 and 8.2).
"""

import numpy as np
from numpy.typing import NDArray

from msl_fem.computing.compiled import compiled
from msl_fem.plant.kernel import advance
from msl_fem.plant.state import COIL_1, COIL_SLOPE_1, OK, SENSOR, V

Array = NDArray[np.float64]


@compiled
def state_readings(state, which, delay, y):  # type: ignore[no-untyped-def]
    """The readings y of a state: `which` 0, 1 currents, 2 the position sensor, each `delay` s ago to first order."""
    for m in range(which.size):
        if which[m] == 2:
            y[m] = state[SENSOR] - delay[m] * state[V]
        else:
            y[m] = state[COIL_1 + which[m]] - delay[m] * state[COIL_SLOPE_1 + which[m]]


@compiled
def filter_run(surface, p, e, timing, setting, state, commands, measured, predicted, states, whitened, voltages):  # type: ignore[no-untyped-def]
    """(samples done, log likelihood) of the predictor along a run.

    Parameters
    ----------
    timing : (step, steps a sample)
    setting : (which, delay, rows, sizes, start, process, noise): the readings and their delays; rows of the state that
        are estimated, sizes of their differences; variances of the start, a sample's process noise, the readings
    state : at the first sample, carried along
    measured, predicted, whitened : (n, n_y): readings; one-step predictions; innovations over their predicted sigma
    states : (n, N_STATE) as known with the sample's readings
    voltages : (n, 2) mean over the sample, predicted from these
    """
    step, n_step = timing
    which, delay, rows, sizes, start, process, noise = setting
    n_x, n_y = rows.size, which.size
    n = n_x + n_y
    covariance, joint, slope = np.diag(start), np.zeros((n, n)), np.zeros((n, n_x))
    base, moved = np.zeros(n), np.zeros(n)
    mean, spare, trial = np.zeros(2), np.zeros(2), state.copy()
    states[0] = state
    state_readings(state, which, delay, predicted[0])
    log_likelihood = 0.0
    for k in range(commands.shape[0]):
        if k > 0:
            predicted[k] = base[n_x:]
            for m in range(n_y):
                c = n_x + m
                error, variance = measured[k, m] - base[c], joint[c, c]
                whitened[k, m] = error / np.sqrt(variance)
                log_likelihood -= 0.5 * (whitened[k, m] ** 2 + np.log(variance))
                for i in range(n):
                    moved[i] = joint[i, c] / variance
                for i in range(n):
                    base[i] += moved[i] * error
                for i in range(n):
                    for j in range(n):
                        joint[i, j] -= moved[i] * moved[j] * variance
            for i in range(n_x):
                state[rows[i]] = base[i]
                for j in range(n_x):
                    covariance[i, j] = 0.5 * (joint[i, j] + joint[j, i])
            states[k] = state
        trial[:] = state
        if advance(surface, p, e, trial, commands[k], 0.0, step, n_step, mean) != OK:
            return k, log_likelihood
        _gather(trial, rows, which, delay, base)
        voltages[k] = mean
        ended = trial.copy()
        for i in range(n_x):
            trial[:] = state
            trial[rows[i]] += sizes[i]
            if advance(surface, p, e, trial, commands[k], 0.0, step, n_step, spare) == OK:
                _gather(trial, rows, which, delay, moved)
                for j in range(n):
                    slope[j, i] = (moved[j] - base[j]) / sizes[i]
        state[:] = ended
        joint[:, :] = slope @ covariance @ slope.T
        for i in range(n_x):
            joint[i, i] += process[i]
        for m in range(n_y):
            joint[n_x + m, n_x + m] += noise[m]
    return commands.shape[0], log_likelihood


@compiled
def _gather(state, rows, which, delay, out):  # type: ignore[no-untyped-def]
    for i in range(rows.size):
        out[i] = state[rows[i]]
    state_readings(state, which, delay, out[rows.size :])


@compiled
def ahead(surface, p, e, timing, readings, states, commands, horizon, predicted, voltages):  # type: ignore[no-untyped-def]
    """Predictions `horizon` samples ahead of each of `states` (n, N_STATE) into row k + horizon; nan where it fails.

    `voltages` receives the mean voltages of the sample before, the last that these states answer for. Returns the
    number of predictions that left the table or the range.
    """
    step, n_step = timing
    which, delay = readings
    mean, state, failed = np.zeros(2), states[0].copy(), 0
    for k in range(states.shape[0] - horizon):
        state[:] = states[k]
        status, done = OK, 0
        while done < horizon and status == OK:
            status = advance(surface, p, e, state, commands[k + done], 0.0, step, n_step, mean)
            done += 1
        if status == OK:
            state_readings(state, which, delay, predicted[k + horizon])
            voltages[k + horizon - 1] = mean
        else:
            failed += 1
    return failed
