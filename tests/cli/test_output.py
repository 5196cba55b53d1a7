"""What every command shares: plain JSON, exit status, one line for an error."""

from pathlib import Path

import pytest

from msl_fem.cli.effects_told import effects_told
from msl_fem.cli.output import print_result, run_guarded, say, write_json
from msl_fem.errors import ComputationError, InputError
from msl_fem.plant.effects import EffectValues


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (InputError("a\n  b"), 2, "error: a b"),
        (ComputationError("diverged"), 1, "failed: diverged"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (OSError(28, "No space left on device", "x.nc"), 1, "failed: x.nc: No space left on device; make room"),
        (OSError(36, "File name too long", "x.nc"), 2, "error: x.nc: File name too long; choose a shorter name"),
    ],
)
def test_an_error_is_one_line_and_a_status(
    error: BaseException, status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> None:
        raise error

    assert run_guarded(fail) == status
    assert said in capsys.readouterr().err


def test_a_defect_of_the_program_is_not_hidden() -> None:
    def fail() -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_guarded(fail)


def test_people_get_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    fields = {"force_N": 1.5, "flux": {"yoke": [1.0, 2.0]}, "many": list(range(9)), "mesh_error": 0.00108}
    fields |= {"gap_m": 0.0007, "slope_N_per_m": -229218.0, "runs": {"step": {"position_rms_m": 3.2e-6}}, "done": True}
    fields |= {
        "winding_temperature_K": 353.15,
        "standard_error": 0.02,
        "zone_reach_m": {"A": 3.5e-4},
        "density_T": {"leg": 0.86},
        "brings 1.2 T at 0.6 mm": "3 A",
        "guard": {"peak_currents_A": {"10 s": 19.8}, "phase_margin_deg": 49.3, "stiffness_peak_dB": -0.0},
        "unseen": {"error_median": 0.0032, "held_share_at_least": 0.86},
        "peak_gain_dB": 0.3,
        "peak_gain_Hz": 120.0,
    }
    print_result(fields, as_json=False, title="t")
    printed = " ".join(capsys.readouterr().out.split())
    assert "flux: yoke 1, 2" in printed
    for line in (
        "force 1.5 N", "mesh error 0.108 %", "gap 0.7 mm", "slope -229.2 kN/m", "runs, step: position RMS 3.2 µm",
        "done yes", "winding temperature 80 °C", "standard error 0.02", "zone reach: A 0.35 mm",
        "density: leg 0.86 T", "brings 1.2 T at 0.6 mm 3 A",
        "guard, peak currents: 10 s 19.8 A", "guard: phase margin 49.3 deg", "guard: stiffness peak 0 dB",
        "unseen: error median 0.32 %", "unseen: held share at least 86 %", "peak gain 0.3 dB peak gain, at 120 Hz",
    ):  # fmt: skip
        assert line in printed, line
    assert "0 ... 8 (9 values)" in printed


def test_a_long_name_stands_whole_in_a_narrow_window(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    name = "inverse domain known but left to feedback"
    print_result({name: ["a" * 12, "b" * 12], "force_N": 1.0}, as_json=False, title="t")
    printed = capsys.readouterr().out
    assert name in printed
    assert "…" not in printed
    assert printed.count("a") - name.count("a") == 12 + "force".count("a")


def test_a_fitted_gain_is_no_cause_for_people() -> None:
    """A diagnosis writes the position reading's gain as an effect; JSON keeps the name, people read what it is."""
    gain = EffectValues({"position_sensor_nonlinearity": {"gain_error": 1e-3}, "time_delay": {"command": 2e-5}})
    bent = EffectValues({"position_sensor_nonlinearity": {"gain_error": 1e-3, "cubic": 50.0}})
    assert set(effects_told(gain, as_json=True)) == {"position_sensor_nonlinearity", "time_delay"}
    assert set(effects_told(gain, as_json=False)) == {"fitted gain of the position reading", "time_delay"}
    assert effects_told(bent, as_json=False) == ["position_sensor_nonlinearity"]


def test_a_folder_that_is_made_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_guarded(lambda: write_json({"a": 1}, tmp_path / "mistyped" / "map.json")) == 0
    assert "note: the folder" in capsys.readouterr().err
    assert run_guarded(lambda: write_json({"a": 2}, tmp_path / "mistyped" / "map.json")) == 0
    assert capsys.readouterr().err == ""


def test_news_hold_nothing_that_cannot_be_read(capsys) -> None:
    """A file's own words may hold byte order marks and terminal codes."""
    say("note: map.json: \ufeff\x1b[31mred\u2028 10 µm")
    assert capsys.readouterr().err == "note: map.json:   [31mred  10 µm\n"
