"""One fit by another tool: python peer_identification.py TOOL DATA.npz prints a, b, c and the CPU seconds as JSON.

DATA holds y, u (n_inputs, n_samples) and the sampling period. `c` is null where the tool has no noise polynomial or
drops it. Run by benchmarks/identification.py under the interpreter that holds the tools; imports nothing of ours.
"""

import contextlib
import json
import sys
import time

import numpy as np


def sippy(y, u, period):
    from sippy_unipi import system_identification

    n = len(u)
    # Its delay 0 is the sample before: b_1 acts on u(t - 1).
    orders = [[2], [[2] * n], [2], [[0] * n]] if n > 1 else [2, 2, 2, 0]
    begun = time.process_time()
    model = system_identification(y, u, "ARMAX", ARMAX_orders=orders, ARMAX_mod="ILLS", tsample=period)
    seconds = time.process_time() - begun
    a = np.ravel(model.DENOMINATOR[0][0])[1:3]
    b = [np.ravel(row) for row in model.NUMERATOR[0]]
    return a, b, np.ravel(model.NUMERATOR_H[0][0])[1:3], seconds


def sysidentpy(y, u, unbiased):
    from sysidentpy.basis_function import Polynomial
    from sysidentpy.model_structure_selection import FROLS
    from sysidentpy.parameter_estimation import LeastSquares

    n = len(u)
    model = FROLS(
        order_selection=False, n_terms=2 + 2 * n, ylag=2, xlag=[[1, 2]] * n if n > 1 else 2, elag=2,
        estimator=LeastSquares(unbiased=unbiased), basis_function=Polynomial(degree=1), model_type="NARMAX",
    )  # fmt: skip
    begun = time.process_time()
    model.fit(X=u.T, y=y[:, None])
    seconds = time.process_time() - begun
    found = dict.fromkeys((channel, lag) for channel in range(1, n + 2) for lag in (1, 2))
    for code, value in zip(np.ravel(model.final_model), np.ravel(model.theta), strict=False):
        if int(code):
            found[divmod(int(code), 1000)] = float(value)
    values = {key: value or 0.0 for key, value in found.items()}
    a = [-values[1, 1], -values[1, 2]]
    return a, [[values[k, 1], values[k, 2]] for k in range(2, n + 2)], None, seconds


def main(tool, path):
    data = np.load(path)
    scale = np.std(data["y"])  # the tools work on outputs of about one, whatever the units
    y, u = data["y"] / scale, data["u"]
    with contextlib.redirect_stdout(sys.stderr):
        if tool == "sippy-ills":
            a, b, c, seconds = sippy(y, u, float(data["period"]))
        else:
            a, b, c, seconds = sysidentpy(y, u, tool == "sysidentpy-els")
    lists = {"a": np.asarray(a).tolist(), "b": (scale * np.asarray(b)).tolist()}
    print(json.dumps({**lists, "c": None if c is None else np.asarray(c).tolist(), "seconds": seconds}))


if __name__ == "__main__":
    main(*sys.argv[1:])
