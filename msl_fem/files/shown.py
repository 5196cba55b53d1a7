"""What a record shows of itself in a notebook: a line with units, a table of its facts, a picture, a data frame."""

from abc import abstractmethod
from collections.abc import Mapping
from html import escape
from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

PICTURES = "msl_fem.report.notebook"
"""The module whose `picture_of` draws a record: the one import by name of a later room, see docs/architecture.md."""
UNIT_ENDINGS = ("m_per_s", "ohm", "Wb", "Hz", "m", "A", "V", "N", "s", "K", "H", "J", "T")
STYLE = "border-collapse:collapse"


class Picture(Protocol):
    """A figure of matplotlib, which a notebook shows without further ado."""

    def savefig(self, fname: Any, **options: Any) -> None:
        """Writes the picture to a file or a stream."""
        ...


class Shown:
    """A record that shows itself; it states its `facts`, all else follows."""

    @abstractmethod
    def facts(self) -> Mapping[str, str]:
        """What a reader wants to know first: name to value with its unit."""

    def __repr__(self) -> str:
        told = ", ".join(f"{name} {value}" for name, value in self.facts().items())
        return f"{type(self).__name__}({told})"

    def _repr_html_(self) -> str:
        """The facts as a small table, texts escaped."""
        rows = "".join(f"<tr><th>{escape(name)}</th><td>{escape(value)}</td></tr>" for name, value in self._rows())
        caption = f"<caption><b>{escape(type(self).__name__)}</b></caption>"
        return f'<table style="{STYLE}">{caption}{rows}</table>'

    def _rows(self) -> list[tuple[str, str]]:
        return list(self.facts().items())

    def plot(self, **choices: Any) -> Picture:
        """The record as a picture of matplotlib, which a notebook shows and `savefig` writes; no window is opened.

        `choices` are those of the record's function in `msl_fem.report.notebook`, such as `gaps` of a table.
        """
        picture: Picture = import_module(PICTURES).picture_of(self, **choices)
        return picture


class Tabular(Shown):
    """A record that is a table of columns over one, such as the time of a run."""

    @abstractmethod
    def frame_columns(self) -> Mapping[str, NDArray[Any]]:
        """Columns (n_row,) by name with the SI unit at its end, that over which the others stand first."""

    def to_pandas(self) -> "pd.DataFrame":
        """The columns as a frame over the first of them; names end in SI units, `position_m`."""
        import pandas as pd

        columns = {name: np.array(values) for name, values in self.frame_columns().items()}
        return pd.DataFrame(columns).set_index(next(iter(columns)))

    def to_xarray(self) -> "xr.Dataset":
        """The columns as variables over the first of them, each with its SI unit as attribute `units`."""
        import xarray as xr

        columns = self.frame_columns()
        over = next(iter(columns))
        parts = {name: (over, np.array(values), _attributes(name)) for name, values in columns.items()}
        return xr.Dataset({name: part for name, part in parts.items() if name != over}, coords={over: parts[over]})


def _attributes(column: str) -> dict[str, str]:
    """The unit in which a column's name ends; none where it ends in no unit."""
    unit = next((unit for unit in UNIT_ENDINGS if column.endswith(f"_{unit}")), "")
    return {"units": unit.replace("_per_", "/")} if unit else {}
