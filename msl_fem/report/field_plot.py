"""The field as an interactive figure: the picture of |B| and flux lines, with values under the pointer and zoom."""

import base64
import io

import numpy as np
import plotly.graph_objects as go
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from msl_fem.magnetics.kinds.e_core import MagnetField
from msl_fem.magnetics.solver.magnetostatics import FieldSolution
from msl_fem.report.field_picture import COLOURS, HIGHEST, PaintedField, paint, painted_field
from msl_fem.report.style import figure

Array = NDArray[np.float64]
PICTURE_WIDTH = 1500  # pixels
N_HOVER = 150  # points along the longer side whose |B| can be read


def field_plot(field: MagnetField, solution: FieldSolution) -> go.Figure:
    """|B| in T and flux lines of equal flux over the whole section; the pointer reads |B| at the nearest grid point."""
    painted = painted_field(field, solution)
    left, right, bottom, top = painted.area
    made = figure(x="x in mm", y="y in mm", height=520)
    made.add_layout_image(
        source=f"data:image/png;base64,{_picture(painted)}", xref="x", yref="y", x=left, y=top,
        sizex=right - left, sizey=top - bottom, sizing="stretch", layer="below",
    )  # fmt: skip
    x, y, b = flux_density_grid(painted)
    made.add_trace(
        go.Heatmap(
            x=x.astype(np.float32), y=y.astype(np.float32), z=b.astype(np.float32), opacity=0.0, zmin=0, zmax=HIGHEST,
            showscale=False, name="|B|",
            hovertemplate="x %{x:.2f} mm, y %{y:.2f} mm<br>|B| = %{z:.3f} T<extra></extra>",
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
    found = np.asarray(find(*np.meshgrid(np.abs(x), y)), dtype=np.int64)
    return x, y, np.where(found < 0, np.nan, painted.flux_density[found])


def _picture(painted: PaintedField) -> str:
    """The area alone, without axes, as PNG in base64."""
    left, right, bottom, top = painted.area
    made = Figure(figsize=(10.0, 10.0 * (top - bottom) / (right - left)))
    FigureCanvasAgg(made)
    axes = made.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    paint(axes, painted)
    buffer = io.BytesIO()
    made.savefig(buffer, format="png", dpi=PICTURE_WIDTH / 10)
    return base64.b64encode(buffer.getvalue()).decode()


def _colour_bar() -> go.Scatter:
    """An empty trace that carries the picture's colours as a scale."""
    bar = {"title": {"text": "|B| in T", "side": "right"}, "thickness": 14, "outlinewidth": 0}
    marker = {"color": [0.0, HIGHEST], "cmin": 0, "cmax": HIGHEST, "colorscale": COLOURS.capitalize(), "colorbar": bar}
    return go.Scatter(x=[None], y=[None], mode="markers", marker=marker, showlegend=False, hoverinfo="skip")
