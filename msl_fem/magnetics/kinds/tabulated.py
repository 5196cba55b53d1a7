"""A magnet known by a table alone."""

from typing import Literal

from msl_fem.files.schema import FrozenModel


class TableMagnet(FrozenModel):
    """A magnet known by a measured or foreign table.

    Attributes
    ----------
    table : its file, relative to this one
    """

    kind: Literal["table"]
    table: str
