"""Writes the laws of the three controllers into rig.toml: python laws.py FOLDER_OF_THE_REPOSITORY.

The authors logged their filter's estimates beside the measurements, so the laws can be read off the logs: the filter,
estimates (z_hat, i_hat) from position, current and duty of the last two samples; the controller, duty from the
estimates. Both are linear, so least squares finds them, and what is left over says how exactly: it is printed, and
written beside each law. Each is turned into a state space from (position_m, current_1_A) to voltage_1_V; between two
points of the multimeter's table 1 of duty are 11.6 V. The reference and constants drop out (see docs/comparison.md).
"""

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from convert import RUNS
from scipy.io import loadmat

from msl_fem.files.toml_text import toml_text

VOLTS_OF_DUTY = 11.6
PERIOD = 1e-3
BEGIN, END = "# laws: written by laws.py", "# end of laws"
AT = 10e-3  # m: the filter is scheduled by the reference; this is where its law is taken


@dataclass(frozen=True, eq=False)
class Filter:
    """(z_hat, i_hat)[k] = now (z_hat, i_hat, z, i, duty)[k-1] + before (the same)[k-2]; residual over spread."""

    now: np.ndarray
    before: np.ndarray
    residual: float


@dataclass(frozen=True, eq=False)
class Law:
    """duty = own duty[k-1] + position (z_hat[k], z_hat[k-1], z_hat[k-2]) + current i_hat[k] + integral sum(z_hat)."""

    own: float
    position: np.ndarray
    current: float
    integral: float
    residual: float


def kept(log: np.ndarray, reach: int, *, level: float | None = None) -> np.ndarray:
    """Samples of a log in steady reference (of one level) for `reach` samples, duty within its limits."""
    reference, duty = log[1], log[12]
    k = np.arange(1000, log.shape[1])
    good = np.ones(k.size, bool)
    for n in range(reach + 1):
        good &= np.isclose(reference[k - n], reference[k]) & (duty[k - n] > 1e-6) & (duty[k - n] < 1 - 1e-6)
    if level is not None:
        good &= np.isclose(reference[k], level)
    return k[good]


def fitted(columns: list[np.ndarray], wanted: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients by least squares, columns scaled, and the residual over the spread of what is wanted."""
    table = np.array(columns).T
    scale = np.abs(table).max(axis=0)
    found = np.linalg.lstsq(table / scale, wanted, rcond=1e-14)[0] / scale
    return found, float((wanted - table @ found).std() / wanted.std())


def filter_of(log: np.ndarray) -> Filter:
    z, i, z_hat, i_hat, duty = log[2], log[4], log[8], log[10], log[12]
    k = kept(log, 2, level=AT)
    columns = [c[k - n] for n in (1, 2) for c in (z_hat, i_hat, z, i, duty)]
    columns.append(np.ones(k.size))
    rows, residuals = zip(*(fitted(columns, c[k]) for c in (z_hat, i_hat)), strict=True)
    both = np.array(rows)
    return Filter(both[:, :5], both[:, 5:10], max(residuals))


def law_of(log: np.ndarray, kind: str) -> Law:
    """`pid`: duty on its last value and three errors; else a state feedback, with the sum of the error if `lqi`."""
    reference, z_hat, i_hat, duty = log[1], log[8], log[10], log[6]
    k = kept(log, 2)
    error = z_hat - reference
    if kind == "pid":
        found, left = fitted([duty[k - 1], error[k], error[k - 1], error[k - 2]], duty[k])
        return Law(float(found[0]), found[1:4], 0.0, 0.0, left)
    levels = np.unique(np.round(reference[k], 9))
    columns = [z_hat[k], z_hat[k - 1], i_hat[k], *(np.isclose(reference[k], one).astype(float) for one in levels)]
    if kind == "lqi":
        columns.append(np.cumsum(error)[k])
    found, left = fitted(columns, duty[k])
    integral = float(found[-1]) if kind == "lqi" else 0.0
    return Law(0.0, np.array([found[0], found[1], 0.0]), float(found[2]), integral, left)


def state_space(it: Filter, law: Law) -> dict[str, list[list[float]]]:
    """States z_hat, i_hat, two of the filter, z_hat before and before that, duty before, sum of z_hat before."""
    n = 8
    output = np.zeros(n)
    output[0] = law.position[0] + law.integral
    output[1], output[4], output[5] = law.current, law.position[1], law.position[2]
    output[6], output[7] = law.own, law.integral
    a, b = np.zeros((n, n)), np.zeros((n, 2))
    for at, part in ((slice(0, 2), it.now), (slice(2, 4), it.before)):
        a[at, 0:2] += part[:, 0:2]
        a[at] += np.outer(part[:, 4], output)
        b[at] = part[:, 2:4]
    a[0, 2] = a[1, 3] = 1.0
    a[4, 0] = a[5, 4] = 1.0
    a[6] = output
    a[7, 0] = a[7, 7] = 1.0
    used = [0, 1, 2, 3, 4] + ([5, 6] if law.own else []) + ([7] if law.integral else [])
    a, b, output = a[np.ix_(used, used)], b[used], output[used]
    b[:, 0] *= -1.0  # position_m = nominal gap - z
    c = VOLTS_OF_DUTY * output[None, :]
    return {"a": a.tolist(), "b": b.tolist(), "c": c.tolist(), "d": [[0.0, 0.0]]}


def main(source: Path, target: Path) -> None:
    laws = []
    for (name, (file, _)), kind in zip(RUNS.items(), ("lqi", "lqr", "pid"), strict=True):
        log = loadmat(source / "results" / file)["logouts"]
        it, law = filter_of(log), law_of(log, kind)
        print(f"{name} ({kind}): left over of the filter {it.residual:.1e}, of the law {law.residual:.1e}")
        laws.append({
            "kind": "state-space",
            "runs": [name],
            "inputs": ["position_m", "current_1_A"],
            "outputs": ["voltage_1_V"],
            "source": f"{kind} with its filter, fitted to the authors' own estimates in the log by laws.py; left over "
            f"{it.residual:.1e} of the estimates, {law.residual:.1e} of the duty",
            **state_space(it, law),
        })  # fmt: skip
    rig = target / "rig.toml"
    before, _, rest = rig.read_text(encoding="utf-8").partition(BEGIN)
    text = toml_text({"controller": {"linear": laws}}).partition("[[")
    rig.write_text(f"{before}{BEGIN}\n{text[1]}{text[2]}{END}{rest.partition(END)[2]}", encoding="utf-8")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python laws.py FOLDER_OF_THE_REPOSITORY")
    main(Path(sys.argv[1]), Path(__file__).parent)
