"""Writes the two runs of the EMPS record from the benchmark's .mat files: python convert.py FOLDER_OF_THE_MAT_FILES.

Each run keeps what was logged: time, motor force = gtau * motor voltage, position and its reference. Time is written to
1 ns, positions to 0.1 nm (the encoder's step in DATA_EMPS is 50 nm), the force to 10 uN (its step between samples is
some 10 mN): finer than anything that was measured.
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

RUNS = {"emps": "DATA_EMPS.mat", "emps_pulses": "DATA_EMPS_PULSES.mat"}
FORMAT = {"time_s": "%.9f", "force_N": "%.5f", "position_m": "%.10f", "reference_m": "%.10f"}


def columns_of(mat_file: Path) -> dict[str, np.ndarray]:
    """The columns of a run (n_sample,) in SI units; force and position count in the same direction."""
    log = {name: np.ravel(values) for name, values in loadmat(mat_file).items() if not name.startswith("__")}
    return {
        "time_s": log["t"],
        "force_N": log["gtau"] * log["vir"],
        "position_m": log["qm"],
        "reference_m": log["qg"],
    }


def main(source: Path, target: Path) -> None:
    for run, mat_file in RUNS.items():
        columns = columns_of(source / mat_file)
        texts = [[FORMAT[name] % v for v in values] for name, values in columns.items()]
        rows = [",".join(row) for row in zip(*texts, strict=True)]
        (target / f"{run}.csv").write_text("\n".join([",".join(columns), *rows, ""]), encoding="utf-8")
        print(f"{run}.csv: {len(rows)} samples")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("usage: python convert.py FOLDER_OF_THE_MAT_FILES")
    main(Path(sys.argv[1]), Path(__file__).parent)
