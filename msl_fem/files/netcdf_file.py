"""NetCDF files: those of strangers read whole, without links elsewhere or arrays beyond all memory; ours written.

An HDF5 file of a few bytes can name other files in its links and declare arrays of any size. And a damaged one makes
the libraries above h5py complain on stderr long after its error was caught; so h5py alone looks at all of it first.
"""

import io
import mmap
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import xarray as xr
from xarray.backends import H5NetCDFStore

MOST_OBJECTS = 1000
_HEAP = b"GCOL\x01\x00\x00\x00"


def read_netcdf(path: Path, *, most_values: int) -> xr.Dataset:
    """The data set in a file, loaded; times stay numbers.

    Raises
    ------
    ValueError : not NetCDF-4, damaged, more than `most_values` values, or parts that lie in other files; says which
    """
    try:
        refuse_endless_heap(path)
        _look_through(path, most_values)
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as data:
            return data.load()
    except Exception as err:  # the HDF5 stack raises errors of many kinds on a damaged file
        raise ValueError(str(err) or type(err).__name__) from err


def write_netcdf(data: xr.Dataset, path: Path, *, encoding: Mapping[str, Mapping[str, Any]]) -> None:
    """Writes a data set as NetCDF-4, made in memory: where a disk is full, the HDF5 library kills the process.

    Raises
    ------
    OSError : the file cannot be written
    """
    content = io.BytesIO()
    with h5netcdf.File(content, "w") as file:
        data.dump_to_store(H5NetCDFStore(file), encoding=encoding)
    path.write_bytes(content.getvalue())


def refuse_endless_heap(path: Path) -> None:
    """ValueError where the HDF5 library would go round for ever: a free object of no size in a global heap.

    A heap holds texts and references of any length ("GCOL", HDF5 File Format Specification 3.0, III.E); the library
    steps from object to object by their sizes, and one flipped bit can make a step that leads nowhere.
    """
    with path.open("rb") as stream:
        if not stream.seek(0, 2):
            return
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
            at = content.find(_HEAP)
            while at >= 0:
                end = min(at + int.from_bytes(content[at + 8 : at + 16], "little"), len(content))
                place = at + 16
                while place + 16 <= end:
                    size = int.from_bytes(content[place + 8 : place + 16], "little")
                    free = content[place : place + 2] == bytes(2)
                    if free and size == 0:
                        raise ValueError("its heap of texts is damaged; make the file anew")
                    place += size if free else 16 + (size + 7) // 8 * 8
                at = content.find(_HEAP, at + 8)


def _look_through(path: Path, most_values: int) -> None:
    """ValueError, or what h5py raises, where a part of the file should not or cannot be read."""
    values = 0
    with h5py.File(path, "r") as file:
        found: list[Any] = [file]
        for at, item in enumerate(found):  # grows as it goes
            if at > MOST_OBJECTS:
                raise ValueError(f"it holds more than {MOST_OBJECTS} objects")
            dict(item.attrs)
            if isinstance(item, h5py.Dataset):
                if item.external or item.is_virtual:
                    raise ValueError(f"'{item.name}' lies in another file; write one file that holds all")
                values += item.size or 0
            elif isinstance(item, h5py.Group):
                for name in item:
                    if not isinstance(item.get(name, getlink=True), h5py.HardLink):
                        raise ValueError(f"'{name}' is a link; write one file that holds all")
                    found.append(item[name])
    if values > most_values:
        raise ValueError(f"it declares {values} values, more than the {most_values} that are read")
