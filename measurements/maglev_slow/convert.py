# ruff: noqa
"""Make the CSV files of this folder from a checkout of labcontrol-data/MagLev.
usage: python convert.py CHECKOUT   (needs scipy)
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

SRC, OUT = Path(sys.argv[1]), Path(__file__).parent
for name, key in (("Classic_PID", "Aclas"), ("Proposed_PID", "A")):
    a = loadmat(SRC / "data" / (name + ".mat"))[key]
    np.savetxt(
        OUT / (name.lower() + ".csv"),
        a,
        delimiter=",",
        comments="",
        header="t_s,position_signal_V,control_signal_V",
        fmt=["%.2f", "%.2f", "%.8g"],
    )
