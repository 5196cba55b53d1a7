"""The field as a picture: |B| in colour, flux lines as contours of A_z."""

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from msl_fem.magnet_field import MagnetField
from msl_fem.magnetostatics import FieldSolution
from msl_fem.whole_file import whole_file

N_FLUX_LINES = 24
AIR = ("air", "strip", "window")
HIGHEST = 2.0  # T, end of the colour scale


def draw_field(field: MagnetField, solution: FieldSolution, *, title: str) -> Figure:
    """A figure of the whole section, the solved half mirrored: |B| in T and flux lines of equal flux."""
    model, mesh = field.model, field.model.mesh
    fine, potential = model.basis.refinterp(solution.potential, nrefs=2)
    x, y = mesh.at_gap(solution.gap, fine.p) * 1e3
    b = _flux_density(x, y, potential, fine.t)
    region = np.array([mesh.names.index("air") if n in AIR else k for k, n in enumerate(mesh.names)])[mesh.region]
    figure = Figure(figsize=(7.2, 5.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    largest = max(np.abs(potential).max(), 1e-12)
    levels = np.linspace(-largest, largest, 2 * N_FLUX_LINES + 2)[1:-1:2]
    colours = mpl.colormaps["viridis"]
    for side in (1, -1):  # A is odd in x, |B| even
        triangles = Triangulation(side * x, y, fine.t.T)
        shaded = axes.tripcolor(triangles, facecolors=b, cmap=colours, vmin=0, vmax=HIGHEST, rasterized=True)
        axes.tricontour(triangles, potential, levels=levels, colors="white", linewidths=0.5, linestyles="solid")
        corner_x, corner_y = mesh.at_gap(solution.gap) * 1e3
        outlines = _region_edges(side * corner_x, corner_y, mesh.triangles, region)
        axes.add_collection(LineCollection(list(outlines), colors="black", linewidths=0.8))
    magnet = field.magnet
    half, margin = max(magnet.half_width, magnet.armature_half_width) * 1e3, 0.2 * magnet.half_width * 1e3
    axes.set_xlim(-half - margin, half + margin)
    axes.set_ylim(-magnet.armature_thickness * 1e3 - margin, (solution.gap + magnet.height) * 1e3 + margin)
    axes.set_aspect("equal")
    axes.set_xlabel("x in mm")
    axes.set_ylabel("y in mm")
    axes.set_title(title, loc="left", fontsize=11)
    figure.colorbar(shaded, ax=axes, label="|B| in T", extend="max" if b.max() > HIGHEST else "neither")
    return figure


def save_picture(figure: Figure, path: Path) -> None:
    """The figure as PNG, whole or not at all; raises InputError where it cannot be written."""
    with whole_file(path) as partial:
        figure.savefig(partial, format="png", dpi=150)


def _region_edges(x: np.ndarray, y: np.ndarray, triangles: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Segments (n, 2, 2) between triangles of different regions."""
    pairs = np.sort(np.concatenate([triangles[[0, 1]], triangles[[1, 2]], triangles[[2, 0]]], axis=1), axis=0)
    owner = np.tile(region, 3)
    order = np.lexsort(pairs)
    pairs, owner = pairs[:, order], owner[order]
    same = (pairs[:, :-1] == pairs[:, 1:]).all(axis=0) & (owner[:-1] != owner[1:])
    edges = pairs[:, :-1][:, same]
    return np.stack([x[edges], y[edges]], axis=-1).transpose(1, 0, 2)


def _flux_density(x: np.ndarray, y: np.ndarray, potential: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """|B| (n_triangle,) in T of the plane through each small triangle's corner potentials; x, y in mm."""
    (x0, x1, x2), (y0, y1, y2), (a0, a1, a2) = x[triangles], y[triangles], potential[triangles]
    twice_area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    along_x = (a1 - a0) * (y2 - y0) - (a2 - a0) * (y1 - y0)
    along_y = (a2 - a0) * (x1 - x0) - (a1 - a0) * (x2 - x0)
    return 1e3 * np.hypot(along_x, along_y) / np.abs(twice_area)
