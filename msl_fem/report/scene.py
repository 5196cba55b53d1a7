"""A solid view of a field with pyvista, made in a process of its own: without GL, rendering kills the process."""

import subprocess
import sys
import tempfile
from pathlib import Path

from msl_fem.files.whole_file import whole_file

TIME_LIMIT = 120  # s


def render_scene(vtu: Path, picture: Path, *, depth: float) -> str:
    """An empty text when the picture was made from a VTU file of `write_vtu`, else the reason why not.

    The half section is mirrored, drawn out over the stack depth (m), and coloured by |B|; air is left out. Nothing is
    raised: a scene is a convenience, and its absence is said.

    Raises
    ------
    InputError : the picture's folder cannot be written
    """
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "scene.png"
        command = [sys.executable, "-m", "msl_fem.report.scene", str(vtu), str(target), repr(depth)]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=TIME_LIMIT, check=False)
        except subprocess.TimeoutExpired:
            done = subprocess.CompletedProcess(command, 1, "", f"no picture after {TIME_LIMIT} s")
        if done.returncode == 0 and target.is_file():
            with whole_file(picture) as partial:
                partial.write_bytes(target.read_bytes())
            return ""
    said = (done.stderr.strip().splitlines() or [f"status {done.returncode}"])[-1]
    how = f"killed by signal {-done.returncode}" if done.returncode < 0 else said
    return f"no scene: rendering is not possible here ({how}); the VTU file shows the same in ParaView"


def _draw(vtu: str, picture: str, depth: float) -> None:
    """The child's work."""
    import numpy as np
    import pyvista

    half = pyvista.read(vtu)
    half["size"] = np.linalg.norm(half["B"], axis=1)
    solid = half.extract_cells(np.flatnonzero(half["solid"] > 0))
    whole = solid.merge(solid.reflect((1, 0, 0)))
    body = whole.extract_surface().extrude((0, 0, depth), capping=True)
    plotter = pyvista.Plotter(off_screen=True, window_size=(1100, 850))
    plotter.add_mesh(body, scalars="size", cmap="viridis", clim=(0, 2), scalar_bar_args={"title": "|B| in T"})
    plotter.view_vector((0.6, 0.35, 1.0), viewup=(0, 1, 0))
    plotter.screenshot(picture)


if __name__ == "__main__":
    _draw(sys.argv[1], sys.argv[2], float(sys.argv[3]))
