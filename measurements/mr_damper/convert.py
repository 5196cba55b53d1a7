# ruff: noqa
"""Make the CSV files of this folder from a checkout of labcontrol-data/mr-damper.
usage: python convert.py CHECKOUT   (needs scipy)
"""

import sys
from pathlib import Path

import numpy as np
from scipy.io import loadmat

SRC, OUT = Path(sys.argv[1]), Path(__file__).parent
# coil voltage (V) -> the records kept; the voltage comes from the authors' sheet, it is not in the records
SERIES = {
    0.0: ["ensaio1.1", "ensaio3.1", "ensaio5.1", "ensaio7.1", "ensaio9.1"],
    0.8712: [
        "ensaio1.2.2",
        "ensaio3.2.2",
        "ensaio5.2.2",
        "ensaio7.2.2",
        "ensaio9.2.2",
        "ensaio.vali.1",
        "ensaio.vali.5",
        "ensaio.vali.7",
    ],
    1.98: ["ensaio.B.1", "ensaio.B.3", "ensaio.B.5", "ensaio.B.7", "ensaio.B.9"],
    2.178: ["ensaio.vali.A.1", "ensaio.vali.A.2", "ensaio.vali.A.3"],
    3.212: ["ensaio.A.1", "ensaio.A.3", "ensaio.A.5", "ensaio.A.7", "ensaio.A.9"],
}
index = ["file,original,coil_voltage_V,rows,x_min_m,x_max_m,force_min_N,force_max_N,frequency_Hz"]
for volt, names in SERIES.items():
    for name in names:
        m = loadmat(SRC / "data" / (name + ".mat"))
        t, x, f = (np.ravel(m[k]).astype(float) for k in ("Tout", "dist", "forc"))
        x = x * 1e-3
        out = name.replace("ensaio", "run_").replace("run_.", "run_").replace(".", "_") + ".csv"
        np.savetxt(
            OUT / out,
            np.c_[t, x, f],
            delimiter=",",
            comments="",
            header="t_s,x_m,force_N",
            fmt=["%.2f", "%.7g", "%.7g"],
        )
        # main line of the displacement, leaving out the first 2 s
        s = x[t > 2] - x[t > 2].mean()
        n = 16 * len(s)
        k = np.abs(np.fft.rfft(s * np.hanning(len(s)), n))
        fr = np.fft.rfftfreq(n, t[1] - t[0])[np.argmax(k)]
        index.append(
            f"{out},{name}.mat,{volt:g},{len(t)},{x.min():.5g},{x.max():.5g},{f.min():.5g},{f.max():.5g},{fr:.4f}"
        )
(OUT / "index.csv").write_text("\n".join(index) + "\n")
