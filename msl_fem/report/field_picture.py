"""The field as a picture for people: |B| and flux lines on a cut, by matplotlib, and as a figure of a page."""

import base64
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import plotly.graph_objects as go
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from msl_fem.files.whole_file import whole_file
from msl_fem.magnetics.field.magnet_field import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.report.figures import figure
from msl_fem.report.paper_figure import PaperFigure

Array = NDArray[np.float64]
COLOURS = "viridis"
N_FLUX_LINES = 24
AIR = ("air", "strip", "window")
HIGHEST = 2.0  # T, end of the colour scale


@dataclass(frozen=True, eq=False)
class PaintedField:
    """A solution on a refined mesh of the solved half, ready to be drawn.

    Attributes
    ----------
    x, y : (n_point,) mm
    potential : (n_point,) A_z in Wb/m, or r A_phi in Wb: constant on flux lines
    triangles : (3, n_triangle)
    flux_density : (n_triangle,) |B| in T
    outlines : (n_edge, 2, 2) mm, the edges between regions
    area : left, right, bottom, top of what is shown, in mm
    axes : names of the coordinates
    mirrored : the section is the solved half and its mirror image
    """

    x: Array
    y: Array
    potential: Array
    triangles: NDArray[np.int64]
    flux_density: Array
    outlines: Array
    area: tuple[float, float, float, float]
    axes: tuple[str, str] = ("x", "y")
    mirrored: bool = True

    @property
    def flux_lines(self) -> Array:
        """Values of the potential whose contours are flux lines with equal flux between them."""
        largest = max(float(np.abs(self.potential).max()), 1e-12)
        return np.linspace(-largest, largest, 2 * N_FLUX_LINES + 2)[1:-1:2]


def painted_field(field: MagnetField, solution: FieldSolution) -> PaintedField:
    """The solution on its mesh refined twice, with the outlines of iron and coil."""
    model, mesh = field.model, field.model.mesh
    fine, potential = model.basis.refinterp(solution.potential, nrefs=2)
    if mesh.motion is None:
        x, y = mesh.at_gap(solution.gap, fine.p) * 1e3
    else:
        _, share = model.basis.refinterp(model.motion_share, nrefs=2)
        x, y = (fine.p + share * mesh.motion.direction[:, None] * (solution.gap - mesh.gap)) * 1e3
    region = np.array([-1 if n in AIR or n.startswith("air") else k for k, n in enumerate(mesh.names)])[mesh.region]
    corner_x, corner_y = mesh.at_gap(solution.gap) * 1e3
    outlines = _region_edges(corner_x, corner_y, mesh.triangles, region)
    if field.section.symmetry == "none":
        b = _flux_density(x, y, potential, fine.t, axisymmetric=False)
        area = _around(outlines, 0.2 * field.magnet.half_width * 1e3)
        return PaintedField(x, y, potential, fine.t, b, outlines, area, mirrored=False)
    _, right, low, high = field.section.body
    margin = 0.2 * field.magnet.half_width * 1e3
    right, low = right * 1e3 + margin, low * 1e3 - margin
    area = (-right, right, low, (high - mesh.gap + solution.gap) * 1e3 + margin)
    if mesh.motion is not None:
        area = (-right, right, low, high * 1e3 + margin)
    b = _flux_density(x, y, potential, fine.t, axisymmetric=model.axisymmetric)
    if not model.axisymmetric:
        return PaintedField(x, y, potential, fine.t, b, outlines, area)
    return PaintedField(x, y, potential * x * 1e-3, fine.t, b, outlines, area, ("r", "z"))


def _around(outlines: Array, margin: float) -> tuple[float, float, float, float]:
    """The area of the outlines and a margin, in mm."""
    left, bottom = (float(value) for value in outlines.min(axis=(0, 1)))
    right, top = (float(value) for value in outlines.max(axis=(0, 1)))
    return left - margin, right + margin, bottom - margin, top + margin


def draw_field(field: MagnetField, solution: FieldSolution, *, title: str) -> PaperFigure:
    """A figure of the whole section, the solved half mirrored: |B| in T and flux lines of equal flux."""
    painted = painted_field(field, solution)
    figure = PaperFigure(figsize=(7.2, 5.6), layout="constrained")
    axes = figure.add_subplot()
    shaded = paint(axes, painted)
    axes.set_aspect("equal")
    axes.set_xlabel(f"{painted.axes[0]} in mm")
    axes.set_ylabel(f"{painted.axes[1]} in mm")
    axes.set_title(title, loc="left", fontsize=11)
    extend = "max" if painted.flux_density.max() > HIGHEST else "neither"
    figure.colorbar(shaded, ax=axes, label="|B| in T", extend=extend)
    return figure


def paint(axes: Axes, painted: PaintedField) -> ScalarMappable:
    """Both halves of the section in the axes, which then show its area."""
    for side in (1, -1) if painted.mirrored else (1,):  # A is odd in x, |B| even
        triangles = Triangulation(side * painted.x, painted.y, painted.triangles.T)
        shaded = axes.tripcolor(
            triangles, facecolors=painted.flux_density, cmap=COLOURS, vmin=0, vmax=HIGHEST, rasterized=True
        )
        axes.tricontour(
            triangles, painted.potential, levels=painted.flux_lines, colors="white", linewidths=0.5, linestyles="solid"
        )
        outlines = painted.outlines * np.array([side, 1])
        axes.add_collection(LineCollection(list(outlines), colors="black", linewidths=0.8))
    axes.set_xlim(*painted.area[:2])
    axes.set_ylim(*painted.area[2:])
    return shaded


def save_picture(figure: PaperFigure, path: Path) -> None:
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


def _flux_density(x: Array, y: Array, potential: Array, triangles: NDArray[np.int64], *, axisymmetric: bool) -> Array:
    """|B| (n_triangle,) in T of the plane through each small triangle's corner potentials; x, y in mm.

    In a body of revolution dA/dr + A/r takes the place of the derivative along x, A/r that of the triangle's middle.
    """
    (x0, x1, x2), (y0, y1, y2), (a0, a1, a2) = x[triangles], y[triangles], potential[triangles]
    twice_area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    along_x = ((a1 - a0) * (y2 - y0) - (a2 - a0) * (y1 - y0)) / twice_area
    along_y = ((a2 - a0) * (x1 - x0) - (a1 - a0) * (x2 - x0)) / twice_area
    if axisymmetric:
        along_x = along_x + (a0 + a1 + a2) / (x0 + x1 + x2)
    return 1e3 * np.hypot(along_x, along_y)


PICTURE_WIDTH = 1500  # pixels
N_HOVER = 150  # points along the longer side whose |B| can be read


def field_plot(field: MagnetField, solution: FieldSolution) -> go.Figure:
    """|B| in T and flux lines of equal flux over the whole section; the pointer reads |B| at the nearest grid point."""
    painted = painted_field(field, solution)
    left, right, bottom, top = painted.area
    across, up = painted.axes
    made = figure(x=f"{across} in mm", y=f"{up} in mm", height=560)
    made.update_layout(meta={"shape": (top - bottom) / (right - left)}, margin={"t": 70})
    made.add_layout_image(
        source=f"data:image/png;base64,{_picture(painted)}", xref="x", yref="y", x=left, y=top,
        sizex=right - left, sizey=top - bottom, sizing="stretch", layer="below",
    )  # fmt: skip
    x, y, b = flux_density_grid(painted)
    made.add_trace(
        go.Heatmap(
            x=x.astype(np.float32), y=y.astype(np.float32), z=b.astype(np.float32), opacity=0.0, zmin=0, zmax=HIGHEST,
            showscale=False, name="|B|",
            hovertemplate=f"{across} %{{x:.2f}} mm, {up} %{{y:.2f}} mm<br>|B| = %{{z:.3f}} T<extra></extra>",
        )
    )  # fmt: skip
    made.add_trace(_colour_bar())
    made.update_xaxes(range=[left, right], showgrid=False, constrain="domain")
    made.update_yaxes(range=[bottom, top], showgrid=False, scaleanchor="x", constrain="domain")
    return made


def flux_density_grid(painted: PaintedField) -> tuple[Array, Array, Array]:
    """x (n_x,) and y (n_y,) in mm and |B| (n_y, n_x) in T on an even grid over the shown area; nan off the mesh."""
    left, right, bottom, top = painted.area
    step = max(right - left, top - bottom) / N_HOVER
    x = np.linspace(left, right, max(2, round((right - left) / step)))
    y = np.linspace(bottom, top, max(2, round((top - bottom) / step)))
    joined = np.round(np.stack([painted.x, painted.y]), 9)  # refined triangles do not share their corners
    corners, place = np.unique(joined, axis=1, return_inverse=True)
    find = Triangulation(corners[0], corners[1], place[painted.triangles].T).get_trifinder()
    found = np.asarray(find(*np.meshgrid(np.abs(x) if painted.mirrored else x, y)), dtype=np.int64)
    return x, y, np.where(found < 0, np.nan, painted.flux_density[found])


def _picture(painted: PaintedField) -> str:
    """The area alone, without axes, as PNG in base64."""
    left, right, bottom, top = painted.area
    made = PaperFigure(figsize=(10.0, 10.0 * (top - bottom) / (right - left)))
    axes = made.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    paint(axes, painted)
    buffer = io.BytesIO()
    made.savefig(buffer, format="png", dpi=PICTURE_WIDTH / 10)
    return base64.b64encode(buffer.getvalue()).decode()


def _colour_bar() -> go.Scatter:
    """An empty trace that carries the picture's colours as a scale."""
    bar = {"title": {"text": "|B| in T", "side": "top"}, "thickness": 12, "outlinewidth": 0, "orientation": "h"}
    bar |= {"y": 1.02, "yanchor": "bottom", "len": 0.6, "x": 0.5}
    marker = {"color": [0.0, HIGHEST], "cmin": 0, "cmax": HIGHEST, "colorscale": COLOURS.capitalize(), "colorbar": bar}
    return go.Scatter(x=[None], y=[None], mode="markers", marker=marker, showlegend=False, hoverinfo="skip")
