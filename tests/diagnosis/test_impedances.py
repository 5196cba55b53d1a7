"""Impedance maps of laws made here from circuits and a ladder of sheets; the right carrier of currents is told."""

import numpy as np
import pytest

from msl_fem.diagnosis.impedances import diagnose_impedance
from msl_fem.errors import InputError, RecordError
from msl_fem.record.impedance import ImpedanceMap, read_impedance

STROKE = np.array([0.0, 1e-3, 4e-3])
FREQUENCY = np.geomspace(50, 2e4, 5)


def shorted(s, inductance):
    """Two coupled circuits, the second one shorted: Z/s = L1 - s M^2/(R2 + s L2), coupled but for the leakage."""
    second, resistance = 0.3, 200.0
    return 4e-3 + inductance - s * inductance * second / (resistance + s * second)


def ladder(s, inductance, sections=200):
    """A sheet cut into layers, each with a shorted loop: the flux diffuses from the surface inwards."""
    step, tau = 1.0 / sections, 2e-3
    depth = np.sqrt(s * tau) * step
    inner = np.ones_like(s)
    derivative = np.zeros_like(s)
    field, total = inner, np.zeros_like(s)
    for _ in range(sections):
        derivative = derivative + depth**2 * field
        total = total + field * step
        field = field + derivative
    return 4e-3 + inductance * total / field


def lcr(law, *, noise=2e-3, seed=1, resistance=False):
    rng = np.random.default_rng(seed)
    stroke, frequency = (a.ravel() for a in np.meshgrid(STROKE, FREQUENCY))
    inductance = 0.1 / (1 + stroke / 3e-3)
    s = 2j * np.pi * frequency
    complex_inductance = law(s, inductance)
    read = complex_inductance.real * (1 + rng.normal(0, noise, stroke.size))
    lost = 50.0 - 2 * np.pi * frequency * complex_inductance.imag
    lost = lost * (1 + rng.normal(0, noise, stroke.size))
    return ImpedanceMap(stroke, frequency, read, lost if resistance else None)


@pytest.mark.parametrize("resistance", [False, True])
def test_a_shorted_winding_is_told(resistance) -> None:
    found = diagnose_impedance(lcr(shorted, resistance=resistance))
    best = found.laws[0]
    assert (found.verdict, best.name) == ("named", "a shorted winding")
    assert best.leakage == pytest.approx(4e-3, rel=0.05)
    assert best.time_constant == pytest.approx(np.full(3, 0.3 / 200), rel=0.03)
    assert best.inductance == pytest.approx(0.1 / (1 + STROKE / 3e-3), rel=0.02)
    assert [cause["effect"] for cause in found.to_json()["causes"]] == ["eddy_currents", "leakage_inductance"]


def test_sheets_are_told_from_a_ladder_of_layers() -> None:
    found = diagnose_impedance(lcr(ladder))
    assert (found.verdict, found.laws[0].name) == ("named", "sheets")
    assert found.laws[0].time_constant == pytest.approx(np.full(3, 2e-3), rel=0.05)


def test_no_frequency_no_name_and_another_law_no_name() -> None:
    assert diagnose_impedance(lcr(lambda s, inductance: inductance + 0 * s)).verdict == "nothing-found"
    found = diagnose_impedance(lcr(lambda s, inductance: inductance * (1 + 0.3 * np.sin(np.log(s.imag)))))
    assert found.verdict == "unexplained"


def test_a_file_is_read_and_refused(tmp_path) -> None:
    path = tmp_path / "impedance.csv"
    path.write_text("stroke_m,frequency_hz,inductance_H\n0,100,0.1\n0,1000,0.05\n")
    with pytest.raises(InputError, match="has 2 frequencies at a stroke; at least 3"):
        diagnose_impedance(read_impedance(path))
    path.write_text("stroke_m,frequency_hz,inductance_H\n0,100,0.1\n0,0,0.05\n")
    with pytest.raises(RecordError, match="column frequency_hz: 0 is not above 0"):
        read_impedance(path)
    for text in ("0,100,0.1,0", "0,100,0.1,-2", "0,100,0.1,1e-320", "0,1e15,0.1,2", "0,100,1e-300,2"):
        path.write_text(f"stroke_m,frequency_hz,inductance_H,resistance_ohm\n0,200,0.1,3\n{text}\n")
        with pytest.raises(RecordError, match=r"row 3 .*, column .* is not above 0, or no reading"):
            read_impedance(path)
    path.write_text("stroke_m,frequency_hz,inductance_H\n")
    with pytest.raises(RecordError, match="there are no rows"):
        read_impedance(path)
    path.write_text("stroke_m,frequency_hz\n0,100\n")
    with pytest.raises(RecordError, match="column inductance_H is missing"):
        read_impedance(path)
