"""What speaks against a map that was read: curves that fall without its saying so, the magnet of another actuator."""

from collections.abc import Mapping

from msl_fem.actuator import Actuator, MagnetKind
from msl_fem.maps.level_currents import OperatingMap, monotone_or_why_not
from msl_fem.maps.pair_limits import PairMap
from msl_fem.table.origin import MAGNET_DIGEST


def falls_unsaid(record: OperatingMap) -> tuple[str, ...]:
    """One sentence for each fall of a curve over the gap that the map's own warnings do not tell of."""
    told = {warning.partition(":")[0] for warning in record.warnings}
    falls = monotone_or_why_not(
        record.levels,
        record.gap,
        record.current,
        error=record.error,
        section=record.section,
        cause="the map does not say it itself: was it changed by hand?",
    )
    return tuple(fall for fall in falls if fall.partition(":")[0] not in told)


def doubt_about_map(actuator: Actuator, record: OperatingMap) -> str | None:
    """Why a map is not that of the actuator's magnet, in a sentence; None where nothing speaks against it."""
    if not record.digest or record.digest == actuator.digest:
        return None
    return doubt_about_origin(actuator, record)


def doubt_about_origin(actuator: Actuator, record: OperatingMap | PairMap) -> str | None:
    """Why a map, of one magnet or of a pair, was made for other magnets; None where nothing speaks for that."""
    of_map, magnet = _magnet_digest(record), actuator.magnet
    if of_map and isinstance(magnet, MagnetKind):
        another = of_map != magnet.digest
    else:
        another = bool(record.actuator) and record.actuator != actuator.name
    if not another:
        return None
    return f"it was made for the magnet of {record.actuator[:80]!r}, and is taken here for that of {actuator.name!r}"


def _magnet_digest(record: OperatingMap | PairMap) -> str:
    """Of the magnet that the map, or the table behind it, was computed for; empty where it does not say."""
    provenance = record.provenance or {}
    table = provenance.get("table")
    origins = (provenance, table if isinstance(table, Mapping) else {})
    return next((str(one[MAGNET_DIGEST]) for one in origins if one.get(MAGNET_DIGEST)), "")
