"""Meshes from files whose gap moves: beside the kind of the same section, and force beside virtual work.

    python benchmarks/moving_meshes.py

1. The U-core UI 60: the whole table of the half section (kind = "u-core") against tables of three meshes of the whole
   section (kind = "mesh"), which together follow all its gaps.
2. The bearing's pole pair: over 20 gaps the force against the slope of the coenergy, against Maxwell's stress, and
   against a mesh made afresh at that gap, by the error that `solve` states.
"""

import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import meshio
import numpy as np

ROOT = Path(__file__).parent.parent
sys.path += [str(ROOT / "tests" / "magnetics"), str(ROOT / "geometries")]

import make_bearing  # noqa: E402
from foreign_meshes import boxed, foreign  # noqa: E402
from make_u_core import named  # noqa: E402

from msl_fem.actuator import Actuator, load_actuator  # noqa: E402
from msl_fem.magnetics.field.magnet_field import field_of, gap_reach, solve  # noqa: E402
from msl_fem.magnetics.solver.mesh import MeshSize, triangulate  # noqa: E402
from msl_fem.magnetics.sweep.table_sweep import SweepSettings, default_grid, sweep  # noqa: E402

EVERY = 1, 6  # of the default grid's gaps and currents
MADE_AT = {3e-4: (0.0, 7e-4), 9e-4: (7e-4, 1.6e-3), 2e-3: (1.6e-3, 1.0)}  # m: a mesh's own gap, and those it is asked
GAPS, CURRENT = 20, 5.0
STEP = 1e-4  # of the gap, for the coenergy's slope


def u_core_tables(folder: Path) -> dict[str, object]:
    """Largest relative differences over all nodes where current flows."""
    actuator = boxed(load_actuator(ROOT / "geometries" / "u_core_ui60.toml"))
    gaps, currents = (values[::every] for values, every in zip(default_grid(actuator), EVERY, strict=True))
    settings = SweepSettings(accuracy="normal")
    ours, report = sweep(actuator, gaps, currents, settings=settings)
    largest = dict.fromkeys(("force", "flux_linkage", "coenergy"), 0.0)
    for gap, range_ in MADE_AT.items():
        follows = gaps[(gaps >= range_[0]) & (gaps < range_[1])]
        theirs, _ = sweep(foreign(actuator, gap, folder), follows, currents, settings=settings)
        i, g = np.meshgrid(currents[1:], follows)
        for name in largest:
            off = np.abs(theirs.evaluate(i, g)[name] / ours.evaluate(i, g)[name] - 1)
            print(
                json.dumps({"made_at_m": gap, "gaps_m": follows.tolist(), name: off.max(axis=1).tolist()}), flush=True
            )
            largest[name] = max(largest[name], float(off.max()))
    return {
        "u_core_table": {"gaps": gaps.size, "currents": currents.size, "accuracy": "normal"},
        "mesh_error": report.mesh_error,
        "largest_differences": largest,
    }


def fresh_bearing(gap: float, folder: Path, actuator: Actuator) -> Actuator:
    """The bearing as a mesh that was made with its rotor where it stands at a gap."""
    drawn = make_bearing.bearing_section()
    rotor = drawn.regions[1]
    assert rotor.name == "armature"
    down = gap - make_bearing.GAP
    moved = replace(rotor, vertices=tuple((x, y - down) for x, y in rotor.vertices))
    section = replace(drawn, regions=(drawn.regions[0], moved, *drawn.regions[2:]), gap=gap)
    mesh = triangulate(section, MeshSize(corner=0.15, gap=1.0, iron=0.4, growth=0.5))
    file = folder / f"bearing_{gap:g}.msh"
    meshio.write(file, named(mesh), file_format="gmsh22", binary=False, float_fmt=".9g")
    content = actuator.magnet.model_dump(exclude_none=True) | {"mesh": str(file), "gap": gap}
    magnet = type(actuator.magnet).model_validate(content)
    return Actuator.model_validate({"schema": 1, "name": "fresh", "magnet": magnet.model_dump(exclude_none=True)})


def bearing_forces(folder: Path) -> dict[str, object]:
    """Over gaps and currents: what was largest, and how often a difference was above the stated error."""
    actuator = load_actuator(ROOT / "geometries" / "bearing_pole_pair.toml")
    low, high = gap_reach(actuator.magnet)
    field = field_of(actuator, actuator.magnet.gap)
    rows = []
    for gap in np.geomspace(low * 1.01, high * 0.99, GAPS).tolist():
        point = solve(actuator, CURRENT, gap)
        force = point.quantities.force
        left, right = (field.quantities(field.solve(CURRENT, gap * (1 + k * STEP))).coenergy for k in (-1, 1))
        other = solve(fresh_bearing(gap, folder, actuator), CURRENT, gap)
        off = (
            abs(force / ((left - right) / (2 * STEP * gap)) - 1),
            abs(point.quantities.force_stress_tensor / force - 1),
            abs(force / other.quantities.force - 1),
            point.force_error_estimate,
            other.force_error_estimate,
        )
        rows.append(off)
        print(json.dumps({"gap_m": gap, "force_N": force, "off": off}), flush=True)
    table = np.array(rows)
    return {
        "bearing": {"gaps_m": [low * 1.01, high * 0.99], "points": len(rows)},
        "force_beside_coenergy_slope": float(table[:, 0].max()),
        "force_beside_stress": float(table[:, 1].max()),
        "force_beside_fresh_mesh": float(table[:, 2].max()),
        "stated_error": [float(table[:, 3].min()), float(table[:, 3].max())],
        "beyond_stated_error": {
            "coenergy_slope": int((table[:, 0] > table[:, 3]).sum()),
            "stress": int((table[:, 1] > table[:, 3] + 1e-9).sum()),
            "fresh_mesh": int((table[:, 2] > table[:, 3] + table[:, 4]).sum()),
        },
    }


def main() -> None:
    """Two JSON lines of results."""
    with tempfile.TemporaryDirectory() as name:
        print(json.dumps(bearing_forces(Path(name))), flush=True)
        print(json.dumps(u_core_tables(Path(name))))


if __name__ == "__main__":
    main()
