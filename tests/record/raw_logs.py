"""One run as many laboratories would have written it: the file, and the text or file of columns that reads it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
from scipy.io import savemat


def position(t):
    return 3e-3 * np.sin(40 * t) + 1e-4 * np.sin(700 * t)


def force(t):
    return 2 + np.cos(90 * t)


N = 1200
RATE = 1000.0
T = np.arange(N) / RATE
POSITION = position(T)
FORCE = force(T)
PLAIN = "time_s={},force_N={},position_m={}:unit=mm"


@dataclass(frozen=True)
class RawLog:
    """A form of a log: who writes so, how, and the columns that read it; `import` options beside them."""

    name: str
    ending: str
    write: Callable[[Path], object]
    columns: str
    rate: float | None = None
    resampled: float | None = None
    package: str = ""


def cells(*columns, fmt="%.9g", delimiter=","):
    return [delimiter.join(fmt % value for value in row) for row in zip(*columns, strict=True)]


def lines(path: Path, *parts, encoding="utf-8", end="\n"):
    rows = []
    for part in parts:
        rows += [part] if isinstance(part, str) else part
    path.write_bytes((end.join(rows) + end).encode(encoding))


MM = POSITION * 1e3


def bare(path):
    lines(path, cells(T, FORCE, MM))


def savetxt(path):
    np.savetxt(path, np.c_[T, FORCE, MM], header="t motor probe")


def comma(path):
    body = [row.replace(".", ",") for row in cells(T, FORCE, MM, delimiter=";")]
    lines(path, "Zeit;Kraft;Weg", "(s);(N);(mm)", body, encoding="latin-1", end="\r\n")


def excel_unicode(path):
    lines(path, "t\tF\tµ", cells(T, FORCE, MM, delimiter="\t"), encoding="utf-16")


def tektronix_tds(path):
    keys = ["Record Length,1.2e+03,,", "Sample Interval,1e-03,,", "Trigger Point,0,,", *[",,,"] * 3]
    keys += ["Source,CH1,,", "Vertical Units,V,,", "Horizontal Units,s,,"]
    body = cells(T, FORCE, MM)
    lines(path, [(keys[k] if k < len(keys) else ",,,") + row + "," for k, row in enumerate(body)])


def tektronix_mso(path):
    head = ["Model,MSO64B", "Firmware Version,1.2.3", "", "Waveform Type,ANALOG", "Point Format,Y"]
    head += ["Horizontal Units,s", "Sample Interval,1e-03", f"Record Length,{N}", "Zero Index,0", "Vertical Units,V,V"]
    head += ["Label,,", "TIME,CH1,CH2"]
    lines(path, head, cells(T, FORCE, MM))


def rigol(path):
    body = [row + ",," for row in cells(np.arange(N), FORCE, MM)]
    lines(path, "X,CH1,CH2,Start,Increment,", "Sequence,Volt,Volt,-5.000000e-01,1.000000e-03", body)


def rigol_first(path):
    lines(path, "Time,CH1,CH2", "Second,Volt,Volt", cells(T, FORCE, MM, fmt="%.8e"))


def lecroy(path):
    head = ["LECROYWR620Zi,47423,Waveform", f"Segments,1,SegmentSize,{N}", "Segment,TrigTime,TimeSinceSegment1",
            "#1,21-Nov-2026 12:00:00,0", "Time,Ampl,Ampl2"]  # fmt: skip
    lines(path, head, cells(T, FORCE, MM))


def keysight(path):
    lines(path, "x-axis,1,2", "second,Volt,Volt", cells(T, FORCE, MM, fmt="%+.8E"))


def infiniium(path):
    head = ["Revision:,0", "Type:,raw", "Start:,0", f"Points:,{N}", "XInc:,1e-03", "XOrg:,0", "Data:,"]
    lines(path, head, cells(FORCE, MM))


def labview(path):
    head = ["LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "***End_of_Header***\t",
            "X_Value\tForce\tProbe\tComment"]  # fmt: skip
    lines(path, head, cells(T, FORCE, MM, delimiter="\t"))


def picoscope(path):
    lines(path, "Time,Channel A,Channel B", "(ms),(V),(V)", "", cells(T * 1e3, FORCE, MM))


def rounded(path):
    lines(path, "t,F,x", cells(np.round(T * 1.0037, 2), FORCE, MM))


def jittered(path):
    rng = np.random.default_rng(1)
    t = T + rng.uniform(-2e-4, 2e-4, N)
    lines(path, "t,F,x", cells(t, force(t), 1e3 * position(t)))


def two_rates(path):
    """Each row has the cells that were sampled then: the position five times as often."""
    body = []
    for k in range(N + 1):
        slow = f"{force(k / RATE):.9g}" if k % 5 == 0 else ""
        body.append(f"{k / RATE:.4f},{slow},{1e3 * position(k / RATE):.9g}")
    lines(path, "t,F,x", body)


def matlab_4(path):
    savemat(path, {"t": T, "motor": FORCE, "q": MM}, format="4")


def matlab_structure(path):
    savemat(path, {"log": {"time": T, "signals": {"values": np.c_[FORCE, MM]}}}, do_compression=True)


def matlab_7_3(path):
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (("t", T), ("motor", FORCE), ("q", MM)):
            file[f"run/{name}"] = values[:, None]


def workbook(path):
    import openpyxl

    book = openpyxl.Workbook()
    for row in [["measured on Monday", None, None], ["t", "F", "x"], ["s", "N", "mm"], *np.c_[T, FORCE, MM].tolist()]:
        book.active.append(row)
    book.save(path)


def tdms(path):
    from nptdms import ChannelObject, TdmsWriter

    with TdmsWriter(path) as writer:
        clock = {"wf_increment": 1 / RATE, "wf_start_offset": 0.0}
        writer.write_segment(
            [ChannelObject("daq", "F", FORCE, clock), ChannelObject("daq", "x", MM, clock | {"unit_string": "mm"})]
        )


def mdf(path):
    from asammdf import MDF, Signal

    with MDF(version="4.10") as file:
        file.append([Signal(FORCE[::2], T[::2], name="F", unit="N")])
        file.append([Signal(MM, T, name="x", unit="mm")])
        file.save(path, overwrite=True)


FORMS = [
    RawLog("no header", ".csv", bare, PLAIN.format(1, 2, 3)),
    RawLog("numpy savetxt", ".txt", savetxt, PLAIN.format("t", "motor", "probe")),
    RawLog("decimal comma, units below", ".csv", comma, PLAIN.format("Zeit", "Kraft", "Weg")),
    RawLog("UTF-16 with tabs", ".txt", excel_unicode, PLAIN.format("t", "F", "µ")),
    RawLog("Tektronix TDS", ".csv", tektronix_tds, PLAIN.format(1, 2, 3)),
    RawLog("Tektronix MSO", ".csv", tektronix_mso, PLAIN.format("TIME", "CH1", "CH2")),
    RawLog("Rigol 1000Z", ".csv", rigol, PLAIN.format("time:offset=0.5 s", "CH1", "CH2")),
    RawLog("Rigol 1000E", ".csv", rigol_first, PLAIN.format("Time", "CH1", "CH2")),
    RawLog("LeCroy", ".csv", lecroy, PLAIN.format("Time", "Ampl", "Ampl2")),
    RawLog("Keysight InfiniiVision", ".csv", keysight, PLAIN.format("x-axis", "ch1", "ch2")),
    RawLog("Keysight Infiniium", ".csv", infiniium, PLAIN.format("time", 1, 2)),
    RawLog("LabVIEW", ".lvm", labview, PLAIN.format("X_Value", "Force", "Probe")),
    RawLog("PicoScope", ".csv", picoscope, PLAIN.format("Time:unit=ms", "Channel A", "Channel B")),
    RawLog("rounded, rate given", ".csv", rounded, PLAIN.format("t", "F", "x"), rate=RATE),
    RawLog("jittered", ".csv", jittered, PLAIN.format("t", "F", "x"), resampled=RATE),
    RawLog("two rates", ".csv", two_rates, PLAIN.format("t", "F", "x"), resampled=RATE),
    RawLog("MATLAB 4", ".mat", matlab_4, PLAIN.format("t", "motor", "q")),
    RawLog("MATLAB 5, Simulink structure", ".mat", matlab_structure,
           PLAIN.format("log.time", "log.signals.values[0]", "log.signals.values[1]")),
    RawLog("MATLAB 7.3", ".mat", matlab_7_3, PLAIN.format("run.t", "run.motor", "run.q")),
    RawLog("workbook", ".xlsx", workbook, PLAIN.format("t", "F", "x"), package="openpyxl"),
    RawLog("TDMS", ".tdms", tdms, PLAIN.format("F.time", "F", "x"), package="nptdms"),
    RawLog("MDF 4, two rates", ".mf4", mdf, "force_N=F:time=F.time,position_m=x:unit=mm:time=x.time", resampled=RATE,
           package="asammdf"),
]  # fmt: skip
