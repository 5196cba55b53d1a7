"""ARMAX at the statistical limit: four cases against the Cramer-Rao bound, beside sippy-unipi and sysidentpy.

    python benchmarks/identification.py [--peer-python /path/to/python] [--seeds 10] [--coverage 100] [--docs]

Every tool runs in its own process, one thread, with a time limit; it fits the same simulated data with the true orders.
The interpreter of --peer-python needs sippy-unipi and sysidentpy. Score: squared parameter error over the bound, 1 when
efficient, a tool without C scored with the true C (in its favour). `--coverage N` fits N further records a case for
failures and for the share of 95 % intervals that hold the truth.
"""

import argparse
import json
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "tests" / "identification"))
from armax_plants import CASES, efficiency, fisher_information  # noqa: E402
from marked_text import rewrite  # noqa: E402

from msl_fem.identification import fit_armax  # noqa: E402

SHORT, LONG = 20_000, 200_000
PEERS = {
    "sippy-unipi ILLS": "sippy-ills",
    "sysidentpy FROLS, least squares": "sysidentpy-ls",
    "sysidentpy FROLS, extended least squares": "sysidentpy-els",
}


def simulated(case, n_samples, seed):
    return case.run(n_samples, np.random.default_rng(seed))


def ours(case, n_samples, seed):
    """Efficiency, CPU seconds, coverage share and whether it converged; data and bound are not in the time."""
    run, innovations = simulated(case, n_samples, seed)
    begun = time.process_time()
    model = fit_armax([run], case.orders)
    seconds = time.process_time() - begun
    inside = np.abs(model.parameters - case.theta) < 1.96 * model.standard_errors
    bound = efficiency(case, model.parameters, fisher_information(case, run, innovations))
    return bound, seconds, inside.mean(), model.convergence.converged


def coverage(case, count, seed):
    """Share of intervals that hold the truth and number of fits that failed."""
    shares, failed = [], 0
    for k in range(count):
        run, _ = simulated(case, SHORT, seed + k)
        model = fit_armax([run], case.orders)
        failed += not model.convergence.converged
        shares.append(np.mean(np.abs(model.parameters - case.theta) < 1.96 * model.standard_errors))
    return float(np.mean(shares)), failed


def peer(python, tool, case, n_samples, seed, *, limit):
    """Efficiency and seconds of another tool, or a few words on why there is none."""
    run, innovations = simulated(case, n_samples, seed)
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data.npz"
        np.savez(data, y=run.output, u=np.vstack(list(run.inputs.values())), period=run.sampling_period)
        command = [python, str(ROOT / "benchmarks" / "peer_identification.py"), tool, str(data)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=limit, check=False)
        except subprocess.TimeoutExpired:
            return f"> {limit:g} s"
    if done.returncode:
        return (done.stderr.strip().splitlines() or ["failed"])[-1][:60]
    found = json.loads(done.stdout.strip().splitlines()[-1])
    c = case.c[1:] if found["c"] is None else found["c"]
    estimate = np.concatenate([found["a"], np.ravel(found["b"]), c])
    return efficiency(case, estimate, fisher_information(case, run, innovations)), found["seconds"]


def text_of(results):
    """Mean score and time of results, or what went wrong."""
    if any(isinstance(result, str) for result in results):
        return next(result for result in results if isinstance(result, str))
    return f"{np.mean([r[0] for r in results]):.3g}, {np.mean([r[1] for r in results]):.2g} s"


def markdown(given):
    names = [case.name for case in CASES]
    lines = [f"| score, CPU time | {' | '.join(names)} |", "| --- |" + " ---: |" * len(names)]
    rows = {n: [[ours(case, n, s) for s in range(k)] for case in CASES] for n, k in ((SHORT, given.seeds), (LONG, 2))}
    for n, found in rows.items():
        lines.append(f"| this project, N = {n} | {' | '.join(map(text_of, found))} |")
    if given.peer_python:
        for label, tool in PEERS.items():
            cells = [[peer(given.peer_python, tool, c, SHORT, s, limit=given.limit) for s in range(2)] for c in CASES]
            lines.append(f"| {label}, N = {SHORT} | {' | '.join(map(text_of, cells))} |")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    lines += ["", f"| 95 % intervals, {given.coverage} fits a case | {' | '.join(names)} |"]
    lines.append("| --- |" + " ---: |" * len(names))
    studied = [coverage(case, given.coverage, 50_000) for case in CASES]
    lines.append(f"| hold the truth | {' | '.join(f'{share:.1%}' for share, _ in studied)} |")
    lines.append(f"| fits that failed | {' | '.join(str(failed) for _, failed in studied)} |")
    lines += [
        "",
        f"Score: squared parameter error over the Cramer-Rao bound, mean of {given.seeds} seeds (2 at N = {LONG} and "
        f"for the others). One thread, {platform.machine()}, Python {platform.python_version()}; largest memory of the "
        f"process, simulation and bound included, {memory:.0f} MB.",
    ]
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python", help="interpreter with sippy-unipi and sysidentpy")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--coverage", type=int, default=100)
    parser.add_argument("--limit", type=float, default=60.0, help="seconds a fit of another tool may take")
    parser.add_argument("--docs", action="store_true", help="write the table into docs/identification.md")
    given = parser.parse_args()
    text = markdown(given)
    sys.stdout.write(text)
    if given.docs:
        rewrite(ROOT / "docs" / "identification.md", {"benchmark": text})


if __name__ == "__main__":
    main()
