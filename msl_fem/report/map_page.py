"""The report of an operating map that was made from a table: its explorer, and where it comes from."""

from collections.abc import Mapping

import numpy as np

from msl_fem.files.quantity import format_quantity
from msl_fem.maps import OperatingMap
from msl_fem.maps.pair_limits import RELATIONS, PairMap
from msl_fem.report.explorer import explorer
from msl_fem.report.page import Page, Stage
from msl_fem.report.pair_explorer import pair_explorer
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_table import PairTable

Pairs = tuple[tuple[str, str], ...]
_SAID = ("solver", "end_effects", "date")  # of a table's provenance


def map_page(table: MagneticTable, made: OperatingMap, source: str) -> Page:
    """The page of one magnet's map; `source` is the table's file."""
    middle = made.gap.size // 2
    gap = float(made.gap[middle])
    at = format_quantity(gap, "m", digits=3)
    headline = tuple(
        ("not reached" if np.isnan(row[middle]) else f"{row[middle]:.2f} A", f"brings {level:g} T at {at}")
        for level, row in zip(made.levels, made.current, strict=True)
    )
    sentence = (
        "Below the first curve commands are preferred, between the curves discouraged, above the last unacceptable. "
        f"The criterion is the {made.criterion} flux density in the iron of the most loaded section."
    )
    current = float(np.nanmin(np.where(np.isnan(made.current[0]), made.current_max, made.current[0])))
    widget = explorer(table, made, start=(0.75 * current, gap))
    stage = Stage("Operating regions", sentence, (), widget=widget)
    return Page(
        f"{_name(table.provenance)}: operating map",
        "How much current a magnet may carry at each gap.",
        headline,
        (stage,),
        _sources(table.provenance, source),
    )


def pair_map_page(table: PairTable, made: PairMap, source: str) -> Page:
    """The page of a pair's map; `source` is the table's file."""
    each = made.equal_currents()
    headline = tuple(
        (f"{each[k, n]:.2f} A", f"in both sides, armature in the middle, brings {level:g} T, {relation}")
        for n, level in enumerate(made.levels)
        for k, relation in enumerate(RELATIONS)
    )
    sentence = (
        "Both magnets' fluxes meet in the armature: how much one side may carry depends on the other side's current. "
        "Different signs of the currents oppose, their fluxes add in the armature; equal signs aid. "
        f"Positive currents of this actuator's sides are {made.polarity}."
    )
    stage = Stage("Operating regions of both sides", sentence, (), widget=pair_explorer(table, made))
    return Page(
        f"{_name(table.provenance)}: operating map of both sides",
        "What the two currents may be at each position of the armature.",
        headline,
        (stage,),
        _sources(table.provenance, source),
    )


def _name(provenance: Mapping[str, object]) -> str:
    return str(provenance.get("actuator") or "a measured table")


def _sources(provenance: Mapping[str, object], source: str) -> Pairs:
    iron = provenance.get("iron")
    irons = iron.items() if isinstance(iron, Mapping) else ()
    parts = [("table", source), *((f"iron of the {region}", str(text)) for region, text in irons)]
    parts += [(name.replace("_", " "), str(provenance[name])) for name in _SAID if name in provenance]
    return tuple(parts)
