# ruff: noqa
"""Make the CSV files of this folder from checkouts of romanszewczyk/JAmodel and otvam/large_signal_ferrite_apec24.
usage: python convert.py JAMODEL_CHECKOUT FERRITE_CHECKOUT   (needs scipy)
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

JA, FE, OUT = Path(sys.argv[1]), Path(sys.argv[2]), Path(__file__).parent
LOOPS = {
    "loops_m130_27s.csv": ("10_APPA/anisotropic/Characterisitcs_anisotropic_mat", "M130_27s"),
    "loops_mnzn_a.csv": ("1_isotropic/Characterisitcs_isotropic_mat", "MnZn_ferrite"),
    "loops_mnzn_b.csv": ("10_APPA/isotropic/Characterisitcs_isotropic_mat", "MnZn_ferrite"),
    "loops_mnzn_hp.csv": ("11_TwoStepSolver/Characteristics_isotropic_mat", "MnZn_HP_ferrite"),
    "loop_amorphous.csv": ("2_anisotropic/Characterisitcs_anisotropic_mat", "amorf"),
}
for out, (folder, mat) in LOOPS.items():
    h = loadmat(JA / folder / f"H_{mat}.mat")["HmeasT"]
    b = loadmat(JA / folder / f"B_{mat}.mat")["BmeasT"]
    rows = [(k + 1, n, h[n, k], b[n, k]) for k in range(h.shape[1]) for n in range(h.shape[0])]
    np.savetxt(
        OUT / out,
        rows,
        delimiter=",",
        comments="",
        header="loop,sample,H_A_per_m,B_T",
        fmt=["%d", "%d", "%.8g", "%.8g"],
    )

# complex permeability of a ferrite over amplitude and frequency: every tenth frequency, every fourth amplitude
m = loadmat(FE / "dataset/N87_mu_large/data.mat")
f, bm, mu = np.ravel(m["f_vec"]), m["B_mat"], m["mu_mat"]
rows = [
    (f[i], bm[i, j], mu[i, j].real, mu[i, j].imag)
    for i in range(0, len(f), 10)
    for j in range(0, bm.shape[1], 4)
    if np.isfinite(mu[i, j])
]
np.savetxt(
    OUT / "permeability_n87.csv", rows, delimiter=",", comments="", header="f_Hz,B_peak_T,mu_real,mu_imag", fmt="%.7g"
)
