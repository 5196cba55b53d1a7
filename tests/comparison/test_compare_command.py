"""`msl-fem compare`: one JSON object, the two files, one clear line for what is wrong."""

import json

from conftest import ROOT

from msl_fem.record import load_record, write_record

EMPS = str(ROOT / "measurements" / "emps")
FIELDS = {
    "name",
    "run",
    "role",
    "channel",
    "nrmse_one_step",
    "nrmse_ten_step",
    "nrmse_closed_loop",
    "nrmse_free_run",
    "reason",
}


def test_json_and_files(msl_fem, tmp_path):
    from dataclasses import replace

    record = load_record(EMPS)
    runs = tuple(replace(r, columns={k: v[1500:4000] for k, v in r.columns.items()}) for r in record.runs)
    write_record(replace(record, runs=runs), tmp_path / "short")
    result = msl_fem("compare", str(tmp_path / "short"), "-o", str(tmp_path / "out"), "--json").json
    assert set(result) >= {"models", "noise_floor", "verdict", "residuals"}
    assert all(set(row) == FIELDS for row in result["models"])
    stored = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert stored["models"] == result["models"]
    assert (tmp_path / "out" / "report.html").stat().st_size > 1e5


def test_a_faulty_extended_model_is_one_clear_line(msl_fem, tmp_path):
    model = tmp_path / "extended.toml"
    model.write_text(
        (ROOT / "measurements" / "emps" / "actuator.toml").read_text() + "\n[effects.gremlins]\nsize = 1\n"
    )
    said = msl_fem("compare", EMPS, "--extended", str(model)).complaint
    assert "gremlins" in said


def test_no_record_is_one_clear_line(msl_fem, tmp_path):
    assert "rig.toml" in msl_fem("compare", str(tmp_path), "-o", str(tmp_path / "out")).complaint
    assert not (tmp_path / "out").exists()
