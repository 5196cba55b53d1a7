"""A magnet from a DXF drawing of its section: outlines on layers become a mesh with named regions and a file."""

from pathlib import Path
from typing import Any

from msl_fem.errors import InputError
from msl_fem.export.outlined_magnet import SOLID, DrawnMagnet, gap_along, magnet_of_outlines
from msl_fem.magnetics.section import Region

__all__ = ["DrawnMagnet", "magnet_from_dxf"]


def magnet_from_dxf(drawing: str | Path, target: str | Path, magnet: DrawnMagnet) -> Path:
    """Writes an actuator file of the kind "mesh" to `target` (.toml) and its mesh beside it (.msh); gives `target`.

    Closed polylines of straight sides count, on layers whose names begin with core, armature, coil_plus (current out of
    the plane) and coil_minus; those on other layers cut out what lies under them, as windows do. The order of the
    file is that of painting. The gap is the smallest distance between armature and core along the pull.

    Raises
    ------
    InputError : ezdxf is not installed, the file is no DXF, a layer is missing, an outline is open, bent or of another
        kind, or armature and core do not face each other
    """
    outlines = _outlines(Path(drawing), magnet.unit)
    gap = gap_along(outlines, magnet.pull, drawing)
    return magnet_of_outlines(outlines, target, magnet, gap=gap, source=f"drawing {Path(drawing).name}")


def _outlines(path: Path, unit: float | None) -> list[Region]:
    """The closed polylines in the order of the file, in m, by their layers' names."""
    try:
        import ezdxf
    except ImportError as err:
        raise InputError("a DXF drawing needs ezdxf: pip install ezdxf") from err
    try:
        document = ezdxf.readfile(path)
    except (OSError, ezdxf.DXFError) as err:
        raise InputError(f"{path}: cannot be read as DXF ({err}); save it as ASCII DXF") from err
    stated = ezdxf.units.conversion_factor(document.units, ezdxf.units.M) if document.units else 1e-3
    scale = stated if unit is None else unit
    regions = [_region(entity, scale, path) for entity in document.modelspace() if entity.dxftype() not in IGNORED]
    names = {region.name for region in regions}
    for layer in SOLID:
        if not any(name.startswith(layer) for name in names):
            raise InputError(f"{path}: no layer begins with {layer}; there are {', '.join(sorted(names)) or 'none'}")
    return regions


IGNORED = {"TEXT", "MTEXT", "DIMENSION", "HATCH", "POINT", "LEADER", "VIEWPORT"}
"""What explains a drawing and bounds nothing."""


def _region(entity: Any, scale: float, path: Path) -> Region:
    layer, kind = entity.dxf.layer.lower(), entity.dxftype()
    if kind not in ("POLYLINE", "LWPOLYLINE"):
        raise InputError(f"{path}: layer {layer} holds a {kind}; join outlines to closed polylines of straight sides")
    closed = entity.is_closed if kind == "POLYLINE" else entity.closed
    if kind == "POLYLINE":
        points = [(v.dxf.location.x, v.dxf.location.y) for v in entity.vertices]
    else:
        points = [(x, y) for x, y in entity.get_points("xy")]
    if entity.has_arc or not closed:
        problem = "is bent" if entity.has_arc else "is open"
        raise InputError(f"{path}: a polyline on layer {layer} {problem}; close it, and approximate arcs by sides")
    return Region(layer, tuple((scale * x, scale * y) for x, y in points))
