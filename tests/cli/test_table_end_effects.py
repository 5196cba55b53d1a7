"""`table --end-effects`: stated in the file, more flux than without, refused where no field is solved."""

from collections.abc import Callable
from pathlib import Path

from cli_paths import E1

from msl_fem.table.magnetic_table import read_table

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
SECTION = ("--end-effects", "section")
GRID = ("--currents", "1,4 A", "--gaps", "0.3,0.6 mm", "--accuracy", "fast", "--workers", "1", "--json")


def test_table_states_its_end_effects(msl_fem: Run, tmp_path: Path) -> None:
    for name, option in (("plain", ()), ("corrected", ("--end-effects", "section"))):
        assert msl_fem("table", E1, "-o", str(tmp_path / f"{name}.nc"), *GRID, *option).status == 0
    plain, corrected = (read_table(tmp_path / f"{name}.nc") for name in ("plain", "corrected"))
    assert plain.provenance["end_effects"].startswith("none")
    assert "closed form" in corrected.provenance["end_effects"]
    assert (corrected.nodes["flux_linkage"][:, 1:] > 1.005 * plain.nodes["flux_linkage"][:, 1:]).all()


def test_measured_table_has_no_end_effects_to_correct(msl_fem: Run, tmp_path: Path) -> None:
    said = msl_fem("table", E1, "-o", str(tmp_path / "t.nc"), "--measured", str(tmp_path), *SECTION).complaint
    assert "--end-effects" in said
