"""The field of a magnet in three dimensions as a picture: |B| on two planes, through its middle and along a leg."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable

from msl_fem.computing.arrays import Array
from msl_fem.magnetics.three_d.boxes import BoxModel
from msl_fem.magnetics.three_d.readings import field_at
from msl_fem.magnetics.three_d.scalar_potential import PotentialSolution
from msl_fem.report.field_picture import COLOURS, HIGHEST
from msl_fem.report.paper_figure import PaperFigure

N_PIXELS = 260  # along the longer side of a plane
WIDTH, LOWEST, TALLEST = 10.5, 5.2, 8.0  # inches
SHARE = 0.7  # of the width, for both planes without their axes and the scale
MARGIN = 0.25  # of the magnet's half width around it


def draw_solid_field(model: BoxModel, solution: PotentialSolution, *, title: str) -> PaperFigure:
    """|B| in T over (x, y) in the middle of the stack, and over (z, y) in the middle of the leg that bears the coil."""
    figure = PaperFigure(figsize=(WIDTH, _height(model)), layout="constrained")
    left, right = figure.subplots(1, 2, sharey=True)
    leg = max(0.0, sum(model.coil.x) / 2)
    shaded = _paint(left, model, solution, axis=0, at=(leg, 0.0))
    _paint(right, model, solution, axis=2, at=(leg, 0.0))
    left.set(xlabel="x in mm", ylabel="y in mm", title="middle of the stack")
    right.set(xlabel="z in mm", title="middle of the wound leg")
    figure.suptitle(title, fontsize=11)
    figure.colorbar(shaded, ax=[left, right], label="|B| in T", extend="max")
    return figure


def _height(model: BoxModel) -> float:
    """Inches that let both planes fill the figure's width, if they are not too tall."""
    wide = sum(2 * _area(model, axis)[0][1] for axis in (0, 2))
    return float(np.clip(WIDTH * SHARE * np.ptp(_area(model, 0)[1]) / wide, LOWEST, TALLEST))


def _paint(
    axes: Axes, model: BoxModel, solution: PotentialSolution, *, axis: int, at: tuple[float, float]
) -> ScalarMappable:
    """Both halves of the plane over x (axis 0) or z (axis 2) and y, the rest of the point at (x, z) = `at`."""
    across, up = _area(model, axis)
    step = max(2 * across[-1], np.ptp(up)) / N_PIXELS
    a, b = (np.arange(low, high, step) + step / 2 for low, high in (across, up))
    grid_a, grid_b = np.meshgrid(a, b)
    fixed = np.full(grid_a.size, at[1] if axis == 0 else at[0])
    columns = {axis: grid_a.ravel(), 1: grid_b.ravel(), 2 - axis: fixed}
    points = np.column_stack([columns[k] for k in range(3)])
    _, flux, iron = field_at(model, solution, points)
    size = np.linalg.norm(flux, axis=1).reshape(grid_a.shape)
    material = iron + 10 * model.coil.has_turns(*points.T)
    both = 1e3 * np.r_[-a[::-1], a]
    shaded = axes.pcolormesh(both, 1e3 * b, _mirrored(size), cmap=COLOURS, vmin=0, vmax=HIGHEST, rasterized=True)
    edges = _mirrored(material.reshape(grid_a.shape).astype(float))
    for level in np.unique(edges)[1:]:
        axes.contour(both, 1e3 * b, edges >= level, levels=[0.5], colors="white", linewidths=0.8)
    axes.set(xlim=1e3 * across[1] * np.array([-1, 1]), ylim=1e3 * np.array(up), aspect="equal")
    return shaded


def _mirrored(half: Array) -> Array:
    return np.hstack([half[:, ::-1], half])


def _area(model: BoxModel, axis: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """What is shown: from the plane of symmetry to beyond the coil and the iron, and their y with a margin."""
    coil, axis = model.coil, 0 if model.polar else axis
    iron = [box for box in model.boxes if box.iron >= 0]
    reach = coil.clearance + coil.width
    ends = [(box.x, box.z)[axis // 2][1] for box in iron]
    widest = max(*ends, (coil.x, coil.z)[axis // 2][1] + reach)
    margin = MARGIN * max(box.x[1] for box in iron)
    heights = [side for box in iron for side in box.y]
    return (0.0, widest + margin), (min(heights) - margin, max(heights) + margin)
