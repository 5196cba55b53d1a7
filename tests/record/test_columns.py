"""Channels and their columns; files of columns: full precision, and every doubtful cell refused with its place."""

from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st

from msl_fem.errors import RecordError
from msl_fem.record.columns import CHANNELS, Channel, numbers, read_columns, side_columns, write_columns


@pytest.fixture
def csv(tmp_path: Path):
    def make(text: str | bytes) -> Path:
        path = tmp_path / "run.csv"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return make


@given(st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=1, max_size=20))
def test_numbers_are_read_to_the_last_bit(tmp_path_factory: pytest.TempPathFactory, values: list[float]) -> None:
    """A fast parser that is off by one unit in the last place would make time jump and energy appear."""
    path = tmp_path_factory.mktemp("bits") / "run.csv"
    path.write_text("a,b\n" + "".join(f"{v!r},1\n" for v in values))
    assert read_columns(path)["a"].tolist() == values


def test_a_spreadsheets_habits_are_read(csv) -> None:
    """A byte order mark, spaces, quoted numbers, carriage returns, empty rows at the end, a nameless empty column."""
    path = csv('\ufefftime_s, "position_m" ,\r\n0.0, 1e-6,\r\n0.1,"2e-6",\r\n,,\r\n\r\n')
    columns = read_columns(path)
    assert list(columns) == ["time_s", "position_m"]
    assert columns["position_m"].tolist() == [1e-6, 2e-6]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no column names"),
        ("a,a\n1,2\n", "column a is there twice"),
        ("a,\n1,2\n", "column 2 has no name"),
        ("a,b\n1,2\n1,2,3\n", r"row 3 \(sample 1\): 3 cells under 2 names"),
        ("a,b\n1,2,3\n1,2,3\n", r"row 2 \(sample 0\): 3 cells under 2 names"),
        ("a,b\n1\n", r"row 2 \(sample 0\): 1 cells under 2 names"),
        ("a;b\n1;2\n1,2;3\n", r"2 cells under 1 names"),
        (b"a,b\n\xff\xfe,1\n", "cannot be read"),
    ],
)
def test_a_file_that_is_no_table_is_refused(csv, text: str, said: str) -> None:
    path = csv(text)
    with pytest.raises(RecordError, match=said) as caught:
        read_columns(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("", "is missing"),
        ("nan", "is missing"),
        ("NA", "'NA' is not a finite number"),
        ("1_000", "'1_000' is not a finite number"),
        ("inf", "'inf' is not a finite number"),
        ("1e999", "is not a finite number"),
        ("0.5 mm", "'0.5 mm' is not a finite number"),
        ("True", "'True' is not a finite number"),
        ("0x10", "'0x10' is not a finite number"),
        ("1;2", "'1;2' is not a finite number"),
    ],
)
def test_a_cell_that_is_no_number_is_named_by_row_and_column(csv, cell: str, said: str) -> None:
    path = csv(f"time_s,position_m\n0.0,1\n0.1,{cell}\n0.2,3\n")
    with pytest.raises(RecordError, match=said) as caught:
        numbers(read_columns(path)["position_m"], "position_m", path)
    assert f"{path}: row 3 (sample 1), column position_m" in str(caught.value)


def test_a_blank_row_in_the_middle_is_a_missing_value_in_its_place(csv) -> None:
    path = csv("time_s\n0.0\n\n0.2\n")
    with pytest.raises(RecordError, match=r"row 3 \(sample 1\), column time_s: the value is missing"):
        numbers(read_columns(path)["time_s"], "time_s", path)


@pytest.mark.parametrize(("name", "said"), [("run.xlsx", "ending '.xlsx'"), ("run", "ending ''"), ("b.nc", "no such")])
def test_another_format_or_no_file_is_refused(tmp_path: Path, name: str, said: str) -> None:
    with pytest.raises(RecordError, match=said):
        read_columns(tmp_path / name)


def test_a_netcdf_file_that_is_none_is_refused(tmp_path: Path) -> None:
    (tmp_path / "run.nc").write_bytes(b"time_s,position_m\n")
    with pytest.raises(RecordError, match="cannot be read"):
        read_columns(tmp_path / "run.nc")


def test_csv_keeps_nine_digits_and_does_not_make_jitter(tmp_path: Path) -> None:
    """48 kHz for 200 s: with nine digits the time would jitter by 2 % of a period."""
    rng = np.random.default_rng(1)
    time = (9_600_000 + np.arange(2000)) / 48e3
    columns = {"time_s": time, "position_m": 1e-4 * rng.normal(size=2000), "note": np.array(["a,b"] * 2000)}
    write_columns(tmp_path / "run.csv", columns)
    read = read_columns(tmp_path / "run.csv")
    assert np.abs(np.diff(read["time_s"]) * 48e3 - 1).max() < 1e-4
    assert np.abs(read["position_m"] / columns["position_m"] - 1).max() < 5.01e-9
    assert read["note"].tolist() == ["a,b"] * 2000


def test_netcdf_keeps_every_bit(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    columns = {"time_s": np.arange(50) / 3e3, "current_1_A": rng.normal(size=50), "note": np.array(["x"] * 50)}
    write_columns(tmp_path / "run.nc", columns)
    read = read_columns(tmp_path / "run.nc")
    for name, values in columns.items():
        assert read[name].tolist() == values.tolist()


def test_netcdf_over_another_dimension_is_refused(tmp_path: Path) -> None:
    xr.Dataset({"time_s": ("sample", np.arange(3.0))}).to_netcdf(tmp_path / "run.nc", engine="h5netcdf")
    with pytest.raises(RecordError, match="`time` alone"):
        read_columns(tmp_path / "run.nc")


def test_a_channel_and_its_column_name_each_other() -> None:
    names = (
        "time_s position_m velocity_m_per_s force_N reference_m injection_m temperature_K voltage_1_V voltage_2_V "
        "current_1_A current_2_A command_1_A command_2_A flux_linkage_1_Wb flux_linkage_2_Wb"
    )
    assert list(CHANNELS) == names.split()
    assert all(Channel.of(name).column == name for name in CHANNELS)
    flux = Channel.of("flux_linkage_2_Wb")
    assert (flux.quantity, flux.side, flux.index, flux.unit) == ("flux_linkage", 2, 1, "Wb")
    assert side_columns("current", 2) == ["current_1_A", "current_2_A"]
    assert side_columns("command", 0) == []


def test_what_is_no_column_of_a_run_is_said() -> None:
    with pytest.raises(RecordError, match="humidity is no column of a run; there are time_s, position_m"):
        Channel.of("humidity")
    with pytest.raises(ValueError, match="position_m belongs to no side"):
        _ = Channel("position").index
