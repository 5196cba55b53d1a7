"""The section as DXF, read by ezdxf: outlines, layers, units, and the iron's area against the mesher's."""

from pathlib import Path

import ezdxf
import numpy as np
import pytest
from conftest import ROOT

import msl_fem
from msl_fem.actuator import load_actuator
from msl_fem.errors import InputError
from msl_fem.magnetics.field.magnet_field import magnet_mesh


def area_of(points: np.ndarray) -> float:
    x, y = points.T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


@pytest.mark.parametrize("name", ["fast_tool_servo", "pot_core_holding", "u_core_ui60"])
def test_ezdxf_reads_the_section(name: str, tmp_path: Path) -> None:
    actuator = load_actuator(ROOT / "geometries" / f"{name}.toml")
    target = tmp_path / "section.dxf"
    msl_fem.export_as(actuator, target, to="dxf")
    document = ezdxf.readfile(target)
    assert not document.audit().has_errors
    assert document.units == ezdxf.units.MM
    outlines = document.modelspace().query("POLYLINE")
    assert all(line.is_closed for line in outlines)
    areas: dict[str, float] = {}
    for line in outlines:
        points = np.array([(v.dxf.location.x, v.dxf.location.y) for v in line.vertices])
        areas[line.dxf.layer] = areas.get(line.dxf.layer, 0.0) + area_of(points)
    magnet = actuator.magnet_kind()
    gap = actuator.motion.nominal_gap
    mesh, section = magnet_mesh(magnet, gap, "fast"), magnet.section(gap)
    cut = sum(area for layer, area in areas.items() if layer not in section.iron and not layer.startswith("coil"))
    for region in section.iron:  # the mesh is of the right half
        meshed = 2e6 * mesh.areas[mesh.elements(region)].sum()
        assert areas[region] - (cut if region == "core" else 0.0) == pytest.approx(meshed, rel=1e-9), region


def test_draw_writes_one_too_and_says_what_it_cannot(msl_fem, tmp_path: Path) -> None:
    target, servo = tmp_path / "s.dxf", str(ROOT / "geometries" / "fast_tool_servo.toml")
    wide = tmp_path / "wide.dxf"
    msl_fem("draw", servo, "-o", str(target))
    msl_fem("draw", servo, "-o", str(wide), "--gap", "1 mm")
    lows = [
        min(v.dxf.location.y for line in ezdxf.readfile(f).modelspace() for v in line.vertices) for f in (target, wide)
    ]
    assert lows[0] == lows[1], "the armature stands"
    tops = [
        max(v.dxf.location.y for line in ezdxf.readfile(f).modelspace() for v in line.vertices) for f in (target, wide)
    ]
    assert tops[1] - tops[0] == pytest.approx(0.4)


def test_a_mesh_has_no_drawing(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="this one is a mesh"):
        msl_fem.export_as(load_actuator(ROOT / "geometries" / "u_core.toml"), tmp_path / "s.dxf", to="dxf")
    assert not (tmp_path / "s.dxf").exists()
