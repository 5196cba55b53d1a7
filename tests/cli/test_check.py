"""The command `check` on a record and on a raw table."""

import numpy as np
from cli_paths import EMPS, SERVO


def test_a_record_without_doubts(msl_fem) -> None:
    assert msl_fem("check", EMPS, "--json").json["doubts"] == []


def test_a_table_with_a_copied_block(msl_fem, tmp_path) -> None:
    rng = np.random.default_rng(1)
    rows = [(x, k, rng.normal()) for x in range(6) for k in range(9)]
    rows[18:27] = [(2, k, rows[9 + k][2]) for k in range(9)]
    table = tmp_path / "table.csv"
    table.write_text("x,k,v\n" + "".join(f"{x},{k},{v:.9g}\n" for x, k, v in rows))
    (doubt,) = msl_fem("check", str(table), "--labels", "x,k", "--json").json["doubts"]
    assert doubt == "rows 9 to 17 and 18 to 26 are equal in every digit (x 1 and 2)"
    assert "no column 'y'; there are x, k, v" in msl_fem("check", str(table), "--labels", "y", "--json").complaint


def test_an_actuator_file_is_no_data(msl_fem) -> None:
    assert "'msl-fem draw" in msl_fem("check", str(SERVO), "--json").complaint


def test_a_number_that_no_sensor_shows_is_told(msl_fem, tmp_path) -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(60, 2))
    rows[7, 1] = 1e300
    table = tmp_path / "table.csv"
    table.write_text("x,v\n" + "".join(f"{x:.9g},{v:.9g}\n" for x, v in rows))
    outcome = msl_fem("check", str(table), "--json")
    assert outcome.json["doubts"] == ["v reaches 1e+300, more than any sensor shows"]
