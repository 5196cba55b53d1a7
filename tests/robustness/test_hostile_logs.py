"""Logs of other programs that are damaged, lead elsewhere, or would fill the memory: one line, little room."""

import gc
import os
import resource
import signal as signals_of_systems
import struct
import subprocess
import sys
import warnings
import zipfile
import zlib
from collections.abc import Callable, Collection
from pathlib import Path

import h5py
import numpy as np
import pytest
import raw_logs
from scipy.io import savemat

from msl_fem.errors import RecordError
from msl_fem.record import log_limits, log_text
from msl_fem.record.log_apart import SignalsAndUnits, read_apart
from msl_fem.record.log_signals import read_log, signal

N = 2000
SIGNALS = {"t": np.arange(N) / 1e3, "motor": np.sin(np.arange(N) / 50.0)}


def test_a_flipped_bit_in_a_compressed_log_is_one_line(tmp_path: Path) -> None:
    log = tmp_path / "log.mat"
    savemat(log, SIGNALS, do_compression=True)
    good = log.read_bytes()
    refused = 0
    for at in range(150, len(good), len(good) // 60):
        log.write_bytes(good[:at] + bytes([good[at] ^ 4]) + good[at + 1 :])
        try:
            read_log(log)
        except RecordError:
            refused += 1
    assert refused > 30


@pytest.mark.parametrize(
    ("ending", "write"), [(".tdms", raw_logs.tdms), (".mf4", raw_logs.mdf), (".xlsx", raw_logs.workbook)]
)
def test_what_a_library_says_of_a_damaged_log_is_in_the_one_line(
    ending: str,
    write: Callable[[Path], object],
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """npTDMS takes a cut log and logs a warning, a finaliser of asammdf ends in a traceback, files stay open."""
    log, said = tmp_path / f"log{ending}", []
    write(log)
    read_log(log)
    good = log.read_bytes()
    capfd.readouterr()
    monkeypatch.setattr(sys, "unraisablehook", said.append)
    for content in (good[: len(good) // 2], good[:64], b"", b"\x00" * len(good)):
        log.write_bytes(content)
        with warnings.catch_warnings():
            warnings.simplefilter("error", ResourceWarning)
            with pytest.raises(RecordError, match=r"cannot be read .*save it anew"):
                read_log(log)
            gc.collect()
    assert said == []
    assert capfd.readouterr().err == ""


def test_a_reader_that_ends_its_process_ends_no_other(tmp_path: Path) -> None:
    """As asammdf does where a channel lies beyond its record: its native code reads past the end."""
    log = tmp_path / "log.mf4"
    raw_logs.mdf(log)
    whole = read_log(log)
    for reader in (_ends_by_a_signal, _ends_early):
        with pytest.raises(
            RecordError, match=r"log\.mf4: cannot be read \(its reader ended by (a signal 11|status 3)\)"
        ):
            read_apart(reader, log, None)
    only = read_log(log, only={"x"})
    np.testing.assert_array_equal(only["x"], whole["x"])
    assert only.keys() <= whole.keys()
    assert np.isnan(only["F"]).all()


def _ends_by_a_signal(path: Path, only: Collection[str] | None) -> SignalsAndUnits:
    os.kill(os.getpid(), signals_of_systems.SIGSEGV)
    raise AssertionError


def _ends_early(path: Path, only: Collection[str] | None) -> SignalsAndUnits:
    print("not an answer", flush=True)
    os._exit(3)


@pytest.mark.parametrize("part", ["xl/workbook.xml", "xl/worksheets/sheet1.xml", "xl/styles.xml"])
def test_a_workbook_with_a_damaged_part_is_closed(part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole, log, said = tmp_path / "whole.xlsx", tmp_path / "log.xlsx", []
    raw_logs.workbook(whole)
    with zipfile.ZipFile(whole) as good, zipfile.ZipFile(log, "w") as damaged:
        for name in good.namelist():
            content = good.read(name)
            damaged.writestr(name, content[:60] + b"\x00" + content[61:] if name == part else content)
    monkeypatch.setattr(sys, "unraisablehook", said.append)
    with warnings.catch_warnings():
        warnings.simplefilter("error", ResourceWarning)
        with pytest.raises(RecordError, match="cannot be read"):
            read_log(log)
        gc.collect()
    assert said == []


@pytest.mark.parametrize("packed", [False, True])
@pytest.mark.parametrize("kind", [0, 8, 10, 14, 19, 142, 60_000, 2**32 - 1])
def test_data_of_a_type_that_has_none_are_refused(kind: int, packed: bool, tmp_path: Path) -> None:
    """scipy would look the type up beyond the end of its table, and end the process."""
    log = tmp_path / "log.mat"
    content = {"t": SIGNALS["t"], "run": {"x": SIGNALS["motor"], "cells": np.array([SIGNALS["t"], "a"], dtype=object)}}
    savemat(log, content)
    good = log.read_bytes()
    whole = read_log(log)
    places = [at for at in range(128, len(good), 8) if good[at : at + 8] == struct.pack("<II", 9, 8 * N)]
    assert len(places) == 3
    for at in places:
        bad = good[:at] + struct.pack("<I", kind) + good[at + 4 :]
        log.write_bytes(_as_packed(bad) if packed else bad)
        with pytest.raises(RecordError, match=r"cannot be read .*(which has none|ends early|small element)"):
            read_log(log)
    log.write_bytes(_as_packed(good))
    assert read_log(log).keys() == whole.keys()


def _as_packed(plain: bytes) -> bytes:
    """The elements of a file of version 5, each compressed."""
    made, at = plain[:128], 128
    while at < len(plain):
        size = struct.unpack("<I", plain[at + 4 : at + 8])[0]
        element = zlib.compress(plain[at : at + 8 + size])
        made, at = made + struct.pack("<II", 15, len(element)) + element, at + 8 + size
    return made


@pytest.mark.parametrize("kind", ["external", "virtual", "soft link", "external link"])
def test_a_log_that_names_another_file_is_refused(tmp_path: Path, kind: str) -> None:
    """Or any file of this machine would be read, and sent back within a record."""
    secret, log = tmp_path / "secret.txt", tmp_path / "log.mat"
    secret.write_bytes(b"a private key, " * 100)
    with h5py.File(tmp_path / "other.h5", "w") as other:
        other["motor"] = SIGNALS["motor"]
    with h5py.File(log, "w") as file:
        file["t"] = SIGNALS["t"]
        if kind == "external":
            file.create_dataset("motor", (1000,), "u1", external=[(str(secret), 0, 1000)])
        elif kind == "virtual":
            layout = h5py.VirtualLayout((N,), "f8")
            layout[:] = h5py.VirtualSource(tmp_path / "other.h5", "motor", (N,))
            file.create_virtual_dataset("motor", layout)
        elif kind == "soft link":
            file["motor"] = h5py.SoftLink("/t")
        else:
            file["motor"] = h5py.ExternalLink("other.h5", "/motor")
    with pytest.raises(RecordError, match=r"log\.mat: cannot be read .*(lies in another file|is a link)"):
        read_log(log)
    with pytest.raises(RecordError):
        read_log(log, only={"t"})


@pytest.fixture
def of_linux() -> None:
    """A test that asks the system how much memory another process took."""
    if not Path("/proc/self/status").is_file():
        pytest.skip("the system tells no process' memory by /proc")


def peak_memory(code: str, *arguments: str) -> tuple[str, float]:
    """What a program printed, and its largest memory in MB: of its own address space, for what `getrusage` says holds
    that of the process which began it."""
    own = "print(int(open('/proc/self/status').read().split('VmHWM:')[1].split()[0]) / 1024)"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; {code}\n{own}", *arguments],
        capture_output=True, text=True, check=True, timeout=60,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (4 * 2**30,) * 2),
    )  # fmt: skip
    said, _, memory = done.stdout.strip().rpartition("\n")
    return said, float(memory)


READ_T = (
    "from msl_fem.record.log_signals import read_log, signal; log = read_log(sys.argv[1], only={'t'}); "
    "print(sorted(log), signal(log, 't', file='log').size)"
)
REFUSED = (
    "from msl_fem.record.log_signals import read_log; from msl_fem.errors import RecordError\n"
    "try: read_log(sys.argv[1], only={'big'})\nexcept RecordError as err: print(err)\n"
)


@pytest.mark.usefixtures("of_linux")
def test_what_is_not_asked_for_is_not_read(tmp_path: Path) -> None:
    """Of 7.3 a data set of 4 GB that takes a few kB of the file, of version 5 one of 240 MB that is packed."""
    log, packed = tmp_path / "log.mat", tmp_path / "packed.mat"
    with h5py.File(log, "w") as file:
        file["t"] = SIGNALS["t"]
        file.create_dataset("big", (23_000, 23_000), "f8", chunks=(1000, 1000), compression="gzip")
    savemat(packed, {"t": SIGNALS["t"], "big": np.zeros(30_000_000)}, do_compression=True)
    _, without = peak_memory("import msl_fem.record.log_signals")
    # scipy unpacks 128 kB at once, a thousandfold at most, and holds them twice, whatever becomes of them
    for path, room in ((log, 60), (packed, 290)):
        said, memory = peak_memory(READ_T, str(path))
        assert said == f"['big', 't'] {N}"
        assert memory < without + room
    said, memory = peak_memory(REFUSED, str(log))
    assert "more than the 50000000 numbers that are taken of a log; name fewer columns" in said
    assert memory < without + 60


def test_packed_numbers_beyond_measure_are_refused_before_they_are_unpacked(tmp_path: Path, monkeypatch) -> None:
    log = tmp_path / "log.mat"
    savemat(log, {"t": SIGNALS["t"], "run": {"big": np.zeros(300_000)}}, do_compression=True)
    assert log.stat().st_size < 20_000
    monkeypatch.setattr(log_limits, "MOST_VALUES", 200_000)
    with pytest.raises(RecordError, match=r"log\.mat: more than the 200000 numbers"):
        read_log(log)
    with pytest.raises(RecordError, match=r"log\.mat: more than the 200000 numbers"):
        read_log(log, only={"run.big"})
    assert signal(read_log(log, only={"t"}), "t", file=log) == pytest.approx(SIGNALS["t"])


def test_a_long_text_log_is_read_in_blocks(tmp_path: Path, monkeypatch) -> None:
    """The same numbers with small blocks; too many are refused with the way out; so is a row without an end."""
    log = tmp_path / "log.csv"
    rows = [f'{k / 1e3:.3f},"{k % 7}",{"?" if k == 700 else k}' for k in range(N)]
    log.write_text("\n".join(["t,a,b", *rows]) + "\n")
    whole = read_log(log)
    monkeypatch.setattr(log_text, "BLOCK", 333)
    for name, values in read_log(log).items():
        np.testing.assert_array_equal(values, whole[name])
    assert whole["t"] == pytest.approx(SIGNALS["t"])
    assert np.flatnonzero(np.isinf(whole["b"])).tolist() == [700]
    assert np.isnan(read_log(log, only={"t"})["a"]).all()
    monkeypatch.setattr(log_limits, "MOST_VALUES", 3 * N - 1)
    with pytest.raises(RecordError, match=r"log\.csv: more than the 5999 numbers .* cut the log into parts"):
        read_log(log)
    assert read_log(log, only={"t", "b"})["t"].size == N
    log.write_text("t,a\n" + "9" * 2_000_000)
    with pytest.raises(RecordError, match="row 2: longer than 1000000 characters"):
        read_log(log)


@pytest.mark.parametrize("order", [2000, 4000])
def test_numbers_of_another_machine_are_refused_without_a_raw_warning(tmp_path: Path, order: int, recwarn) -> None:
    """VAX and Cray orders of bytes, which a file of version 4 may state, are guessed by the library with a warning."""
    log = tmp_path / "log.mat"
    log.write_bytes(struct.pack("<5i", order, N, 1, 0, 2) + b"t\0" + np.arange(N, dtype="<f8").tobytes())
    with pytest.raises(RecordError, match=r"log\.mat: cannot be read \(We do not support byte ordering"):
        read_log(log)
    assert list(recwarn) == []


def test_digits_of_other_scripts_are_no_numbers(tmp_path: Path) -> None:
    log = tmp_path / "log.csv"
    log.write_text("t,a\n" + "".join(f"{k},\uff11\n" for k in range(5)))  # full-width digits
    assert np.isinf(read_log(log)["a"]).all()
