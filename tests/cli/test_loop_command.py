"""`control --inject` makes the record that `loop` measures, page and JSON together; what is no such record is said."""

from cli_paths import SERVO, TABLE

TEST = "multisine:start=20 Hz,stop=600 Hz,amplitude=0.3 um,bias=0.2 mm,duration=2 s,periods=1"


def test_a_held_loop_under_a_test_signal_is_measured_as_designed(msl_fem, tmp_path):
    record, page = tmp_path / "held", tmp_path / "loop.html"
    common = (SERVO, "--table", TABLE, "--belief", "plain", "--json")
    designed = msl_fem("control", *common, "--inject", TEST, "-o", str(record)).json
    assert "unseen" not in designed["loop"], "the run holds a position; there is no reference to judge others by"
    measured = msl_fem("loop", str(record), "--report", str(page), "--json").json
    there = next(p for p in designed["loop"]["positions"] if abs(p["position_m"] - 0.2e-3) < 1e-9)
    low, high = measured["peak_sensitivity_interval"]
    assert low - 0.03 < there["peak_sensitivity"] < high + 0.03, "the sensor's lag, which the belief lacks, is 1 %"
    assert measured["zone"] == "A"
    assert measured["peak_inside_band"]
    assert [run["position_m"] for run in measured["runs"]] == [measured["position_m"]]
    assert "ISO 14839-3" in page.read_text()
    assert "leave --reference out" in msl_fem("control", *common, "--inject", TEST, "--reference", TEST).complaint


def test_a_record_without_a_test_signal_is_refused(msl_fem, tmp_path):
    record = tmp_path / "open"
    run = "sine:frequency=20 Hz,amplitude=10 mA,bias=0.3 A,duration=120 ms"
    common = (SERVO, "--table", TABLE, "--belief", "plain")
    assert msl_fem("simulate", *common, "--excitation", run, "-o", str(record)).status == 0
    assert "no run has a column injection_m" in msl_fem("loop", str(record)).complaint
