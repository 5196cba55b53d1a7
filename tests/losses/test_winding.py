"""Layer windings: no wire in another, none outside the window, two routes to the resistance, the thickest wire."""

import math

import numpy as np
import pytest
from wound_coils import coil_of, servo

from msl_fem.errors import InputError
from msl_fem.losses import choose_wire, fitting_layers, metric_wire, wind, wires

WINDOWS = [(8.0, 16.0, 0.762), (8.0, 16.0, 1.0), (5.3, 7.25, 0.5), (3.0, 3.49, 1.0), (3.0, 3.51, 1.0), (1.0, 9.0, 1.0)]


@pytest.mark.parametrize(("width", "height", "d"), WINDOWS)
@pytest.mark.parametrize("packing", ["square", "orthocyclic"])
def test_wires_neither_overlap_nor_leave_the_window(width: float, height: float, d: float, packing: str) -> None:
    """Every turn as a circle at its place, against every other."""
    layers = fitting_layers(d, width=width, height=height, packing=packing)  # type: ignore[arg-type]
    x = np.concatenate([np.full(n, d / 2 + k * layers.pitch) for k, n in enumerate(layers.turns)])
    aside = d / 2 if packing == "orthocyclic" else 0.0
    y = np.concatenate([d / 2 + (k % 2) * aside + d * np.arange(n) for k, n in enumerate(layers.turns)])
    assert x.size == layers.capacity > 0
    assert x.max() + d / 2 <= width + 1e-9
    assert y.max() + d / 2 <= height + 1e-9
    apart = np.hypot(x[:, None] - x, y[:, None] - y) + 2 * d * np.eye(x.size)
    assert apart.min() >= d * (1 - 1e-9)
    assert width - (x.max() + d / 2) < layers.pitch  # and no further layer fits


def test_a_window_that_fits_exactly_loses_no_turn_to_rounding() -> None:
    assert fitting_layers(0.1, width=0.3, height=0.7).turns == (7, 7, 7)


@pytest.mark.parametrize(
    ("packing", "densest"), [("square", math.pi / 4), ("orthocyclic", math.pi / (2 * math.sqrt(3)))]
)
def test_large_windows_reach_the_packings_density(packing: str, densest: float) -> None:
    layers = fitting_layers(1.0, width=1000.0, height=1000.5, packing=packing)  # type: ignore[arg-type]
    assert layers.capacity * math.pi / 4 / 1000.0 / 1000.5 == pytest.approx(densest, rel=2e-3)


def test_two_routes_to_the_resistance_of_a_full_window() -> None:
    """Wire length over section, and the fill factor's formula of the actuator file: equal where all layers are full."""
    wire = metric_wire(0.71e-3)
    d = wire.outer_diameter
    magnet = coil_of(10 * d, 20 * d, 200)
    winding = wind(magnet, wire)
    assert winding.layers == (20,) * 10
    assert winding.resistance() == pytest.approx(winding.resistance_by_fill_factor(), rel=1e-12)
    stated = magnet.coil.model_copy(update={"fill_factor": winding.fill_factor})
    assert winding.resistance() == pytest.approx(
        magnet.model_copy(update={"coil": stated}).winding_resistance, rel=1e-12
    )


def test_an_outer_part_left_empty_shortens_the_wire() -> None:
    wire = metric_wire(0.71e-3)
    winding = wind(coil_of(20 * wire.outer_diameter, 20 * wire.outer_diameter, 190), wire)
    assert winding.layers == (20,) * 9 + (10,)
    assert winding.turns == 190
    assert winding.resistance() < winding.resistance_by_fill_factor()


@pytest.mark.parametrize("series", ["metric", "awg"])
@pytest.mark.parametrize("grade", [1, 2])
@pytest.mark.parametrize("packing", ["square", "orthocyclic"])
def test_the_next_thicker_wire_does_not_fit(series: str, grade: int, packing: str) -> None:
    actuator = servo()
    options = {"series": series, "grade": grade}
    chosen = choose_wire(actuator, **options, packing=packing).winding  # type: ignore[arg-type]
    thicker = [w for w in wires(**options) if w.diameter > chosen.wire.diameter]  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"200 turns of .* do not fit"):
        wind(actuator.magnet, thicker[0], packing=packing)  # type: ignore[arg-type]
    assert chosen.turns == 200


def test_the_reference_coil() -> None:
    """0.71 mm fills the reference actuator's window to 62 %: its file promises 50 %, less than fits."""
    choice = choose_wire(servo())
    assert choice.winding.wire.name == "0.71 mm"
    assert choice.winding.fill_factor == pytest.approx(200 * math.pi / 4 * 0.71**2 / 128, rel=1e-12)
    assert choice.fill_factor_ratio == pytest.approx(choice.winding.fill_factor / 0.5, rel=1e-12)


def test_too_many_turns_for_any_wire() -> None:
    actuator = servo()
    magnet = coil_of(1e-3, 1e-3, 1000)
    with pytest.raises(InputError, match=r"do not fit the coil's 1 mm by 1 mm even with 0.05 mm"):
        choose_wire(actuator.model_copy(update={"magnet": magnet}))
    with pytest.raises(InputError, match="packing 'random' is unknown"):
        choose_wire(actuator, packing="random")  # type: ignore[arg-type]
