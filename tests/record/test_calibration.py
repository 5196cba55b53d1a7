"""A gauge that is not linear is read through its calibration curve."""

import numpy as np
import pandas as pd
import pytest
from small_record import write_csv

from msl_fem.actuator import parse_actuator
from msl_fem.errors import RecordError
from msl_fem.record.log_columns import column_sources, describe
from msl_fem.record.log_import import import_log

N = 1500
TIME = np.arange(N) * 1e-3
POSITION = 0.4e-3 * np.sin(40 * TIME)
RIG = parse_actuator({"schema": 1, "name": "rig", "motion": {"moving_mass": "1 kg"}, "drive": {"kind": "force"}})
COLUMNS = "time_s=t,force_N=motor,position_m=probe:unit=mm"


def probe(position):
    """V of an eddy-current probe at a distance of 1 mm less the position: it saturates with the distance."""
    return 10 * (1 - np.exp(-(1e-3 - position) / 0.8e-3))


def curve(folder, *, low=-0.5, high=0.5, points=21):
    """What the probe reads at known positions in mm."""
    at = np.linspace(low, high, points)
    write_csv(folder / "probe.csv", {"reading": probe(1e-3 * at), "value": at})
    return folder / "probe.csv"


def log():
    return pd.DataFrame({"t": TIME, "motor": np.cos(90 * TIME), "probe": probe(POSITION)})


def test_a_curve_gives_back_what_was_there(tmp_path) -> None:
    """To 1e-5 of the span from 21 points; the best straight line errs by 6.6 %."""
    read = import_log(log(), f"{COLUMNS}:curve={curve(tmp_path)}", RIG).run["position_m"]
    span = np.ptp(POSITION)
    assert np.abs(read - POSITION).max() < 1e-5 * span
    line = np.polyval(np.polyfit(probe(POSITION), POSITION, 1), probe(POSITION))
    assert np.abs(line - POSITION).max() > 0.06 * span


def test_a_file_of_columns_names_a_curve_beside_it(tmp_path) -> None:
    curve(tmp_path)
    (tmp_path / "columns.toml").write_text('[position_m]\nsource = "probe"\nunit = "mm"\ncurve = "probe.csv"\n')
    (source,) = column_sources(str(tmp_path / "columns.toml"))
    assert source.in_si(probe(np.array([0.1e-3])), file="log.csv") == pytest.approx([0.1e-3], rel=1e-3)
    assert describe([source])["position_m"]["curve"] == "probe.csv"


def test_what_was_not_calibrated_is_refused(tmp_path) -> None:
    with pytest.raises(RecordError, match=r"sample \d+ .*, column probe: .* lies beyond the curve probe\.csv"):
        import_log(log(), f"{COLUMNS}:curve={curve(tmp_path, high=0.3)}", RIG)


@pytest.mark.parametrize(
    ("table", "told"),
    [
        ({"reading": [1, 2, 3], "values": [1, 2, 3]}, "column value is missing"),
        ({"reading": [1, 2], "value": [1, 2]}, "2 points are no curve"),
        ({"reading": [1, 2, 2, 3], "value": [1, 2, 3, 4]}, r"row 4 .*, column reading: 2 is there twice"),
        ({"reading": [4, 3, 2, 1], "value": [1, 2, 1.5, 3]}, r"row 3 .*, column value: the curve turns back"),
        ({"reading": [1, 2, 3, 4], "value": [2, 2, 2, 2]}, r"row 3 .*, column value: the curve turns back"),
        ({"reading": [1, 2, 3, 4], "value": [1, 2, 3, 1]}, r"row 5 .*, column value: the curve turns back"),
        ({"reading": [1, 2, 3, 4], "value": [1, 1, 2, 3]}, r"row 3 .*, column value: the curve turns back"),
    ],
)
def test_a_curve_that_is_none_is_refused(tmp_path, table, told) -> None:
    write_csv(tmp_path / "probe.csv", table)
    with pytest.raises(RecordError, match=told):
        column_sources(f"position_m=q:curve={tmp_path / 'probe.csv'}")
