"""Text files without measure: nested for ever, larger than any, and what the last net of the command line says."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from targets import EXCITATIONS, EXTENDED, LOG, RIG, SERVO, STATIC, TABLE, _record

from msl_fem.cli.output import run_guarded
from msl_fem.errors import ComputationError, InputError, MaterialError
from msl_fem.files.schema import DEEPEST, LARGEST_TEXT, depth, small_text
from msl_fem.materials.core_loss_data import read_loss_points
from msl_fem.plant.extended_model import load_extended_model
from msl_fem.record import Noise, StaticMap
from msl_fem.record.measured_table import table_from_measurements

Run = Callable[..., "Outcome"]  # noqa: F821 - the fixture's type, tests/conftest.py
NESTED = ["x = " + "[" * n + "]" * n for n in (DEEPEST + 2, 900, 5000)] + ["x = " + "{a = " * 60 + "1" + "}" * 60,
          "[" + ".".join("a" * 60) + "]\nb = 1"]  # fmt: skip


@pytest.mark.parametrize("nested", NESTED, ids=["a little", "much", "beyond all", "tables", "dotted"])
def test_a_file_nested_beyond_reason_is_one_line(nested: str, tmp_path: Path, msl_fem: Run) -> None:
    """Every reader of TOML, through the command that reads it."""
    actuator, rig, columns, excitation = (tmp_path / f"{name}.toml" for name in ("a", "rig", "c", "e"))
    actuator.write_text(f"{nested}\n" if nested.startswith("x") else EXTENDED + nested)
    assert msl_fem("flexure", str(actuator)).complaint
    with pytest.raises(InputError):
        load_extended_model(actuator)
    actuator.write_text(SERVO.read_text())
    (tmp_path / "rec").mkdir()
    _record("rig.toml")(tmp_path / "rec").write_text(RIG + "\n[controller]\n" + nested)
    assert msl_fem("identify", str(tmp_path / "rec")).complaint
    columns.write_text(nested)
    (tmp_path / "log.csv").write_text(LOG)
    told = ("import", str(tmp_path / "log.csv"), "--actuator", str(actuator), "-o", str(tmp_path / "new"), "--columns")
    assert msl_fem(*told, str(columns)).complaint
    excitation.write_text(EXCITATIONS + nested)
    said = msl_fem("simulate", str(actuator), "--table", str(TABLE), "--excitation", str(excitation), "-o", str(rig))
    assert said.complaint
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize("n", [60, 900, 5000])
def test_a_map_nested_beyond_reason_is_one_line(n: int, tmp_path: Path, msl_fem: Run) -> None:
    for text in ("[" * n + "]" * n, json.dumps({"schema": 1})[:-1] + ', "gap_m": ' + "[" * n + "]" * n + "}"):
        (tmp_path / "m.json").write_text(text)
        assert msl_fem("guard", str(tmp_path / "m.json"), "--current", "1 A", "--gap", "1 mm").complaint


def test_depth_is_counted_without_recursion() -> None:
    assert depth(1) == 0
    assert depth({"a": [1, {"b": []}]}) == 3
    content: object = 1
    for _ in range(20_000):
        content = [content]
    assert depth(content) == 20_000


def test_a_text_beyond_all_measure_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_bytes(b"#" * LARGEST_TEXT)
    assert len(small_text(path)) == LARGEST_TEXT
    with path.open("ab") as stream:
        stream.write(b"#")
    with pytest.raises(ValueError, match="more than 16 MB"):
        small_text(path)
    with pytest.raises(ValueError, match="a device, no file"):
        small_text("/dev/zero")


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (RecursionError("deep"), 2, "error: what was given is nested too deeply"),
        (MemoryError("Unable to allocate 8 TiB"), 1, "failed: out of memory (Unable to allocate 8 TiB)"),
        (MemoryError(), 1, "failed: out of memory (no size given)"),
    ],
)
def test_what_no_reader_foresaw_is_one_line(error: Exception, status: int, said: str, capsys) -> None:
    def fail() -> None:
        raise error

    assert run_guarded(fail) == status
    assert capsys.readouterr().err.startswith(said)


def static_map() -> StaticMap:
    rows = np.array([line.split(",") for line in STATIC.splitlines()[1:]], dtype=float)
    return StaticMap(
        gap=rows[:, 0], current=rows[:, 1], force=rows[:, 2], flux_linkage=None, role=np.full(len(rows), "fit"),
        direction=None, sequence=None, extra={},
    )  # fmt: skip


def test_noise_below_all_rounding_does_not_break_the_fit() -> None:
    """With a millinewton of noise the normal equations are indefinite at little smoothing; more of it is taken."""
    table, _ = table_from_measurements(static_map(), Noise(force=1e-3))
    rows = static_map()
    assert np.abs(table.force(rows.current, rows.gap) - rows.force).max() < 1e-2 * rows.force.max()
    with pytest.raises(ComputationError, match="no smooth surface can be fitted"):
        table_from_measurements(static_map(), Noise(force=1e-13))


def test_a_current_a_hundred_times_too_large_in_one_row_is_told() -> None:
    """It may be right, for a saturated magnet pulls no more; on every processor the same is made of it."""
    rows = static_map()
    rows.current[0] *= 100
    table, _ = table_from_measurements(rows, Noise(force=0.2, position=50e-9))
    [thin] = [note for note in table.provenance["notes"] if "data are thin" in note]
    assert "have no measurement within 15 % of the measured ranges" in thin
    assert table.provenance["smoothing"] == pytest.approx(31.6, rel=0.01)


def test_a_cell_beyond_the_readers_measure_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "loss.csv"
    path.write_text("frequency_Hz,B_T,loss_W_per_kg\n50,1," + "9" * 200_000 + "\n")
    with pytest.raises(MaterialError, match=r"loss\.csv: not comma-separated values"):
        read_loss_points(path)
