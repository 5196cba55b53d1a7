"""HDF5 files that ask for trouble: links and data elsewhere, arrays without end, heaps without end."""

import time
from pathlib import Path

import h5py
import numpy as np
import pytest
import xarray as xr
from targets import TABLE

from msl_fem.errors import RecordError, TableError
from msl_fem.files.netcdf_file import read_netcdf, write_netcdf
from msl_fem.record.columns import read_columns
from msl_fem.record.log_signals import read_log
from msl_fem.table.magnetic_table import read_table


def bad_file(folder: Path, kind: str) -> Path:
    path = folder / "bad.nc"
    (folder / "secret.txt").write_bytes(bytes(800))
    with h5py.File(folder / "other.h5", "w") as other:
        other["x"] = np.arange(100.0)
    with h5py.File(path, "w") as file:
        if kind == "external link":
            file["gap"] = h5py.ExternalLink("other.h5", "/x")
        elif kind == "soft link":
            file["gap"] = h5py.SoftLink("/nowhere")
        elif kind == "external data":
            file.create_dataset("gap", (100,), "f8", external=[(str(folder / "secret.txt"), 0, 800)])
        elif kind == "virtual data":
            layout = h5py.VirtualLayout((100,), "f8")
            layout[:] = h5py.VirtualSource(folder / "other.h5", "x", (100,))
            file.create_virtual_dataset("gap", layout)
        elif kind == "endless":
            file.create_dataset("gap", (10**12,), "f8", chunks=(1000,))
        elif kind == "a ring of groups":
            file.create_group("a")
            file["a/b"] = file["/"]
        else:
            for k in range(1200):
                file.create_group(str(k))
    return path


@pytest.mark.parametrize(
    ("kind", "said"),
    [
        ("external link", "'gap' is a link"),
        ("soft link", "'gap' is a link"),
        ("external data", "'/gap' lies in another file"),
        ("virtual data", "'/gap' lies in another file"),
        ("endless", "it declares 1000000000000 values, more than the 20000000 that are read"),
        ("a ring of groups", "it holds more than 1000 objects"),
        ("many groups", "it holds more than 1000 objects"),
    ],
)
def test_what_leads_elsewhere_or_has_no_end_is_refused_at_once(tmp_path: Path, kind: str, said: str) -> None:
    path, start = bad_file(tmp_path, kind), time.process_time()
    with pytest.raises(TableError, match=r"bad\.nc: not a magnetic table") as refused:
        read_table(path)
    assert said in str(refused.value)
    assert time.process_time() - start < 5, "of this process alone, however loaded the machine"
    with pytest.raises(RecordError, match=r"bad\.nc: cannot be read"):
        read_columns(path)


def test_a_heap_that_sends_the_library_round_for_ever_is_refused(tmp_path: Path) -> None:
    """One byte less in a table's file, and the HDF5 library never returns."""
    content = bytearray(TABLE.read_bytes())
    heap = content.index(b"GCOL")
    place = heap + 16
    while content[place : place + 2] != bytes(2):
        place += 16 + (int.from_bytes(content[place + 8 : place + 16], "little") + 7) // 8 * 8
    content[place + 8 : place + 16] = bytes(8)
    bad = tmp_path / "bad.nc"
    bad.write_bytes(content)
    with pytest.raises(TableError, match="its heap of texts is damaged"):
        read_table(bad)
    bad.rename(tmp_path / "bad.mat")
    with pytest.raises(RecordError, match="its heap of texts is damaged"):
        read_log(tmp_path / "bad.mat")


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    data = xr.Dataset({"x": ("time", np.arange(5.0), {"units": "m"})}, attrs={"said": "é"})
    write_netcdf(data, tmp_path / "a.nc", encoding={"x": {"zlib": True}})
    assert read_netcdf(tmp_path / "a.nc", most_values=10).identical(data)
    with pytest.raises(ValueError, match="more than the 9 that are read"):
        read_netcdf(tmp_path / "a.nc", most_values=9)


def test_an_empty_file_is_no_netcdf(tmp_path: Path) -> None:
    (tmp_path / "a.nc").touch()
    with pytest.raises(TableError, match="not a magnetic table"):
        read_table(tmp_path / "a.nc")


def test_a_text_that_is_named_as_a_table_is_told_in_words(tmp_path: Path) -> None:
    (tmp_path / "junk.nc").write_text("junk")
    with pytest.raises(TableError, match="no NetCDF-4 and no other HDF5 file"):
        read_table(tmp_path / "junk.nc")
