"""NetCDF files: those of strangers read whole, without links elsewhere or arrays beyond all memory; ours written.

An HDF5 file of a few bytes can name other files in its links and declare arrays of any size. And a damaged one makes
the libraries above h5py complain on stderr long after its error was caught; so h5py alone looks at all of it first.
"""

import io
import mmap
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

MOST_OBJECTS = 1000
_HEAP = b"GCOL\x01\x00\x00\x00"


def read_netcdf(path: Path, *, most_values: int) -> "xr.Dataset":
    """The data set in a file, loaded; times stay numbers.

    Raises
    ------
    ValueError : not NetCDF-4, damaged, more than `most_values` values, or parts that lie in other files; says which
    """
    import xarray as xr

    try:
        refuse_endless_heap(path)
        look_through(path, most_values=most_values)
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False, phony_dims="sort") as data:
            return data.load()
    except Exception as err:  # the HDF5 stack raises errors of many kinds on a damaged file
        raise ValueError(str(err) or type(err).__name__) from err


class NetcdfVariable(NamedTuple):
    """A variable of a NetCDF file: the names of its dimensions, its values and its attributes."""

    dims: tuple[str, ...]
    values: NDArray[Any]
    attributes: dict[str, Any]


def read_variables(path: Path, *, most_values: int) -> tuple[dict[str, NetcdfVariable], dict[str, Any]]:
    """The variables and the attributes of a file; raises as `read_netcdf`.

    A file of plain doubles, as ours are, is read by h5py alone; packed or masked values and their like by xarray, which
    knows the conventions and takes longer to import than a look-up lasts.
    """
    try:
        refuse_endless_heap(path)
        look_through(path, most_values=most_values)
        content = _plain_content(path)
    except Exception as err:  # the HDF5 stack raises errors of many kinds on a damaged file
        raise ValueError(str(err) or type(err).__name__) from err
    if content is not None:
        return content
    data = read_netcdf(path, most_values=most_values)
    variables = {
        str(k): NetcdfVariable(tuple(map(str, v.dims)), v.values, dict(v.attrs)) for k, v in data.variables.items()
    }
    return variables, dict(data.attrs)


_PLAIN = {"units", "long_name"}
_OF_NETCDF = {"_FillValue", "CLASS", "NAME", "DIMENSION_LIST", "REFERENCE_LIST", "_Netcdf4Dimid", "_Netcdf4Coordinates"}


def _plain_content(path: Path) -> tuple[dict[str, NetcdfVariable], dict[str, Any]] | None:
    """Variables and attributes of a file of plain doubles over coordinates of their own; None of any other."""
    import h5py

    variables: dict[str, NetcdfVariable] = {}
    with h5py.File(path, "r") as file:
        for name, item in file.items():
            if not isinstance(item, h5py.Dataset) or item.dtype != np.float64 or item.ndim == 0:
                return None
            if not set(item.attrs) <= _PLAIN | _OF_NETCDF or not np.isnan(item.attrs.get("_FillValue", np.nan)).all():
                return None
            attributes = {key: item.attrs[key] for key in _PLAIN & set(item.attrs)}
            scales = [[item] if item.is_scale else list(axis.values()) for axis in item.dims]
            if any(len(scale) != 1 for scale in scales) or not all(isinstance(v, str) for v in attributes.values()):
                return None
            dims = tuple(str(scale[0].name).removeprefix("/") for scale in scales)
            variables[name] = NetcdfVariable(dims, item[...], attributes)
        given = {key: np.ravel(value) for key, value in file.attrs.items()}
    if any(value.size != 1 for value in given.values()):
        return None
    return variables, {key: value[0] for key, value in given.items()}


def write_netcdf(data: "xr.Dataset", path: Path, *, encoding: Mapping[str, Mapping[str, Any]]) -> None:
    """Writes a data set as NetCDF-4, made in memory: where a disk is full, the HDF5 library kills the process.

    Raises
    ------
    OSError : the file cannot be written
    """
    import h5netcdf
    from xarray.backends import H5NetCDFStore

    content = io.BytesIO()
    with h5netcdf.File(content, "w") as file:
        data.dump_to_store(H5NetCDFStore(file), encoding=encoding)
    path.write_bytes(content.getvalue())


def write_variables(variables: Mapping[str, NetcdfVariable], attributes: Mapping[str, Any], path: Path) -> None:
    """Writes variables of doubles with checksums as NetCDF-4, made in memory as by `write_netcdf`; by h5netcdf alone,
    for xarray takes longer to import than a small table takes to solve.

    Parameters
    ----------
    variables : those of one dimension of their own name are the coordinates

    Raises
    ------
    OSError : the file cannot be written
    """
    import h5netcdf

    content = io.BytesIO()
    with h5netcdf.File(content, "w") as file:
        file.dimensions = {name: one.values.size for name, one in variables.items() if one.dims == (name,)}
        file.attrs.update(attributes)
        for name, one in variables.items():
            made = file.create_variable(
                name, one.dims, data=np.asarray(one.values, float), fillvalue=np.nan, fletcher32=True
            )
            made.attrs.update(one.attributes)
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


def look_through(path: Path, *, most_values: float, most_objects: int = MOST_OBJECTS) -> None:
    """ValueError, or what h5py raises, where a part of an HDF5 file should not or cannot be read.

    It should not where it lies in another file, by a link, as external or as virtual data: a file from elsewhere would
    have any file of this machine read, and sent back.
    """
    import h5py

    if not h5py.is_hdf5(path):
        raise ValueError("the file is no NetCDF-4 and no other HDF5 file")
    values = 0
    with h5py.File(path, "r") as file:
        found: list[Any] = [file]
        for at, item in enumerate(found):  # grows as it goes
            if at > most_objects:
                raise ValueError(f"it holds more than {most_objects} objects")
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
