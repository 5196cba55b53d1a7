"""Whether a record was made under feedback, and what that means for its identification.

In open loop the inputs know nothing of the errors. Under feedback they answer to them: the errors are correlated with
later inputs. The test is the score test of `residual_tests` with the inputs ahead of the errors instead of behind. What
the past of all channels explains is taken out first (P. E. Caines and C. W. Chan, IEEE Trans. Autom. Control 20, 1975):
errors of the model's form depend on past inputs, and so, of a smooth input, on its future.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from msl_fem.computing.blas_threads import one_blas_thread
from msl_fem.identification.data import SampledRun
from msl_fem.identification.model import ArmaxEstimate
from msl_fem.identification.prediction_error import prediction_errors, sensitivity_columns, sensitivity_signals
from msl_fem.identification.prepared import prepared_run
from msl_fem.identification.regression import lagged_blocks, triangular_factor
from msl_fem.identification.residual_tests import CorrelationTest, check_settings, score_test

SOUND_WHEN = (
    "a prediction-error estimate from closed-loop data is sound when something outside the loop excites it (a "
    "reference, an added signal), the loop has a delay of a sample or more (nk >= 1), and the noise model is rich "
    "enough, which the residual tests show; a free run of an unstable plant says nothing, the closed loop with its "
    "controller does"
)


@one_blas_thread
def feedback_tests(
    model: ArmaxEstimate, run: SampledRun, channels: Sequence[str], *, lags: int = 25, alpha: float = 0.01
) -> tuple[CorrelationTest, ...]:
    """One test a channel of the run: its values 1 ... lags samples ahead against the one-step errors.

    `channels` are as recorded (currents, forces): a rational term holds the measured position and answers to its noise
    without any feedback. `lags` of the result are negative. InputError if the run does not fit the model.
    """
    check_settings(lags, alpha, run.n_samples)
    signals, orders = prepared_run(model, run).signals, model.orders
    errors = prediction_errors(signals, model.polynomials, orders).errors
    rows = sensitivity_signals(signals, model.polynomials, errors)
    columns, row_error = sensitivity_columns(orders)
    n_samples = signals.shape[1]
    first = n_samples - errors.size
    variance = float(errors @ errors) / (errors.size - len(columns))  # of the model; the past takes little more
    tests = []
    recorded = [np.asarray(run.inputs[name], dtype=float) for name in channels]
    past = [channel - channel.mean() for channel in recorded]
    behind = [(len(rows) + k, lag) for k in range(len(past)) for lag in range(lags)]
    explained = [*columns, *behind]
    for name, channel in zip(channels, recorded, strict=True):
        ahead = np.concatenate([channel[lags:] - channel.mean(), np.zeros(lags)])
        wanted = [*explained, *((len(rows) + len(past), lag) for lag in range(lags)), (row_error, 0)]
        stacked = np.vstack([rows, *past, ahead])
        blocks = lagged_blocks(stacked, wanted, first=first + lags, last=n_samples - lags)
        factor = triangular_factor(blocks, len(wanted))
        norms = np.linalg.norm(factor[:, len(explained) : -1], axis=0)
        tail = factor[len(explained) :, len(explained) :]
        delays = [lag - lags for lag in range(lags)]
        tests.append(score_test(name, delays, tail=tail, scales=(norms, variance, errors.size - 2 * lags), alpha=alpha))
    return tuple(tests)


def feedback_note(tests: Sequence[CorrelationTest], *, known: bool) -> str | None:
    """The sentence for the reader; None in open loop. `known`: the record says that it was made in closed loop."""
    answering = [test.name for test in tests if not test.inside_band]
    if not known and not answering:
        return None
    seen = f" ({', '.join(answering)} answer to the errors)" if answering else ""
    return f"recorded under feedback{seen}: {SOUND_WHEN}"
