"""Rows and readings that a record says are not valid: the rest is used, and nothing of them is."""

import numpy as np
import pytest
from small_record import RATE, RIG, columns, make, write_csv

from msl_fem.errors import RecordError
from msl_fem.prediction import run_data
from msl_fem.record import load_record, write_record
from msl_fem.record.clipping import clipped_samples

HELD = slice(400, 460)


def flags(count: int = 1000, at: slice = HELD) -> np.ndarray:
    valid = np.ones(count)
    valid[at] = 0
    return valid


def test_rows_that_are_not_valid_cut_the_run(tmp_path) -> None:
    """What they hold does not matter: a position outside the gap, a time that stands still."""
    table = columns() | {"valid": flags()}
    table["position_m"][HELD] = 5e-3
    table["time_s"][HELD] = table["time_s"][400]
    record = load_record(make(tmp_path / "cut", noise=table))
    assert [(run.name, run.time.size) for run in record.runs] == [("noise_1", 400), ("noise_2", 540), ("sweep", 1000)]
    assert record.run("noise_2").time[0] == pytest.approx(460 / RATE)
    assert "noise.csv: 60 of 1000 samples are not valid; taken as noise_1, noise_2" in record.warnings


def test_short_stretches_are_left_out_and_said(tmp_path) -> None:
    record = load_record(make(tmp_path / "short", noise=columns() | {"valid": flags(at=slice(150, 300))}))
    assert [run.time.size for run in record.runs] == [700, 1000]
    assert record.runs[0].name == "noise"
    assert "1 stretches of fewer than 200 samples are left out" in record.warnings[0]


def test_a_law_that_drove_the_run_drove_its_parts(tmp_path) -> None:
    law = '[controller]\n[[controller.linear]]\nkind = "pid"\nkp = "-1 A/m"\noutputs = ["current_1_A"]\n'
    law += 'runs = ["noise"]\n'
    record = load_record(make(tmp_path / "law", rig=RIG + law, noise=columns() | {"valid": flags()}))
    assert record.law_of("noise_2") is not None
    assert record.law_of("sweep") is None


def test_a_reading_that_is_not_valid_leaves_the_run_whole(tmp_path) -> None:
    """Its cells may be empty; a straight line stands there, and the samples are known not to count."""
    table = columns()
    spoilt = {name: values.astype(object) for name, values in table.items()} | {"valid_position_m": flags().astype(int)}
    spoilt["position_m"][HELD] = ""
    record = load_record(make(tmp_path / "mask", noise=spoilt))
    run = record.run("noise")
    line = np.interp(np.arange(400, 460), [399, 460], table["position_m"][[399, 460]])
    np.testing.assert_allclose(run["position_m"][HELD], line)
    np.testing.assert_array_equal(run.extra.keys(), [])
    data = run_data(record, run)
    np.testing.assert_array_equal(data.invalid["position_m"], np.arange(400, 460))
    assert data.first(430).left_out["position_m"].size == 30
    write_record(record, tmp_path / "again")
    again = load_record(tmp_path / "again").run("noise")
    np.testing.assert_array_equal(again.valid["position_m"], run.valid["position_m"])


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"valid": 2 * flags()}, r"row 2 .*, column valid: 2 is neither 1"),
        ({"valid": flags(at=slice(None, None, 100))}, "no stretch of 200 samples"),
        ({"valid_position_m": flags(at=slice(0, 550))}, "leaves 45% of the readings of position_m"),
        ({"valid_current_1_A": flags()}, "current_1_A drives the plant"),
        ({"valid_command_1_A": flags()}, "command_1_A, which is missing"),
    ],
)
def test_masks_that_cannot_be_are_refused(tmp_path, given, told) -> None:
    with pytest.raises(RecordError, match=told):
        load_record(make(tmp_path / "bad", noise=columns() | given))


def test_a_row_is_named_where_it_stands_behind_a_cut(tmp_path) -> None:
    folder = make(tmp_path / "later", noise=columns() | {"valid": flags()})
    table = columns() | {"valid": flags()}
    table["position_m"][470] = np.nan
    write_csv(folder / "noise.csv", table)
    with pytest.raises(RecordError, match=r"noise\.csv from row 462: row 10, column position_m"):
        load_record(folder)


def test_flat_tops_are_clipped_and_rests_and_crests_are_not() -> None:
    time = np.arange(4000) / 1e4
    wave = np.round(1e-4 * np.sin(2 * np.pi * 30 * time) / 1e-7) * 1e-7
    assert clipped_samples(wave).size == 0, "the crest of a quantised sine"
    flat = np.clip(wave, -8e-5, None)
    np.testing.assert_array_equal(clipped_samples(flat), np.flatnonzero(wave <= -8e-5))
    settled = np.round(1e-4 * np.exp(-time / 5e-3) / 1e-7) * 1e-7
    assert clipped_samples(settled).size == 0, "a mover that comes to rest"
    step = np.where(time < 0.2, 0.0, 1e-4 * (1 - np.exp(-(time - 0.2) / 5e-3)))
    assert clipped_samples(np.round(step / 1e-7) * 1e-7).size == 0, "a mover that was at rest"
