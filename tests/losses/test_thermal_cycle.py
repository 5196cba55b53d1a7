"""Temperatures: closed forms of one node, a slow twin of two, where the loss runs away."""

import math

import numpy as np
import pytest
from thermal_networks import ALPHA, one_node, two_nodes

from msl_fem.errors import ComputationError, InputError
from msl_fem.losses import Cycle, Heating, ThermalNetwork, ThermalRunaway, peak_rise, runaway_current, steady_rise


@pytest.mark.parametrize("ambient", [273.15, 293.15, 323.15])
def test_one_node_in_closed_form(ambient: float) -> None:
    """rise = i^2 R_a R_th/(1 - i^2 R_20 alpha R_th), R_a at ambient temperature."""
    heating, current = Heating(resistance=1.5, ambient=ambient), 5.0
    at_ambient = 1.5 * (1 + ALPHA * (ambient - 293.15))
    expected = current**2 * at_ambient * 2.0 / (1 - current**2 * 1.5 * ALPHA * 2.0)
    assert steady_rise(one_node(), heating, current) == pytest.approx([expected], rel=1e-12)


def test_heat_in_is_heat_out() -> None:
    """Two nodes: copper loss at the hot resistance and iron loss leave through the two ways to the ambient."""
    network, heating, current = two_nodes(), Heating(1.0, core_loss=0.5), 1.4
    rise = steady_rise(network, heating, current)
    heat_in = current**2 * (1 + ALPHA * rise[0]) + 0.5
    assert float(network.conductance.sum(axis=0) @ rise) == pytest.approx(heat_in, rel=1e-12)
    assert rise[0] > rise[1] > 0


def test_runaway_is_said() -> None:
    """Just below the limit a finite, huge rise; at it none: the message names the limit."""
    for network in (one_node(), two_nodes()):
        heating = Heating(1.0)
        limit = runaway_current(network, heating)
        assert steady_rise(network, heating, 0.9999 * limit)[0] > 1e6
        with pytest.raises(ThermalRunaway, match=f"from {limit:.4g} A on no temperature balances"):
            steady_rise(network, heating, 1.0001 * limit)
    assert runaway_current(one_node(), Heating(1.5)) == pytest.approx(1 / math.sqrt(1.5 * ALPHA * 2.0), rel=1e-12)
    assert issubclass(ThermalRunaway, ComputationError)


def test_a_cycle_of_one_node_in_closed_form() -> None:
    """T_end = T_on (1 - e^(-a))/(1 - e^(-a - b)) with a, b the phases over their time constants."""
    current, duty, period, resistance, capacity = 8.0, 0.3, 60.0, 2.0, 50.0
    gain = current**2 * ALPHA * resistance
    tau_off = resistance * capacity
    tau_on = tau_off / (1 - gain)
    final = current**2 * resistance / (1 - gain)
    a, b = duty * period / tau_on, (1 - duty) * period / tau_off
    expected = final * (1 - math.exp(-a)) / (1 - math.exp(-a - b))
    found = peak_rise(one_node(), Heating(1.0), current, cycle=Cycle(duty, period))
    assert found == pytest.approx(expected, rel=1e-10)


def twin(network: ThermalNetwork, heating: Heating, current: float, cycle: Cycle) -> tuple[float, float]:
    """The slow twin, many cycles by Euler's small steps: the winding at the end of an on phase,its largest rise."""
    assert cycle.period is not None
    rise, steps = np.zeros(network.capacity.size), 4000
    dt = cycle.period / steps
    cycles = int(12 * network.time_constants[0] / cycle.period) + 1
    end = largest = 0.0
    for n in range(cycles):
        for k in range(steps):
            on = k < cycle.duty * steps
            heat = np.zeros(rise.size)
            if on:
                heat[0] = current**2 * heating.resistance * (1 + ALPHA * (heating.ambient + rise[0] - 293.15))
                heat[-1] += heating.core_loss
            rise = rise + dt * (heat - network.conductance @ rise) / network.capacity
            if n == cycles - 1:
                largest = max(largest, rise[0])
            if k == round(cycle.duty * steps) - 1:
                end = float(rise[0])
    return end, largest


@pytest.mark.parametrize(("duty", "period", "current"), [(0.25, 2000.0, 2.0), (0.6, 800.0, 1.6)])
def test_a_cycle_of_two_nodes_against_the_twin(duty: float, period: float, current: float) -> None:
    """And the end of the on phase is where the winding is warmest."""
    network, heating = two_nodes(), Heating(1.0, ambient=303.15, core_loss=0.4)
    end, largest = twin(network, heating, current, Cycle(duty, period))
    assert peak_rise(network, heating, current, cycle=Cycle(duty, period)) == pytest.approx(end, rel=2e-3)
    assert largest == pytest.approx(end, rel=1e-3)


def test_short_and_long_cycles() -> None:
    """Short against the time constants: the RMS; long: as if the current never paused. Both from the same formula."""
    network, heating, current, duty = two_nodes(), Heating(1.0), 1.5, 0.36
    rms = float(steady_rise(network, heating, current * 0.6)[0])
    assert peak_rise(network, heating, current, cycle=Cycle(duty)) == pytest.approx(rms, rel=1e-12)
    steps = [peak_rise(network, heating, current, cycle=Cycle(duty, p)) - rms for p in (0.2, 0.1)]
    assert steps[1] == pytest.approx(0, abs=2e-2)
    assert steps[0] / steps[1] == pytest.approx(2.0, rel=0.01)  # the ripple goes with the period
    assert peak_rise(network, heating, current, cycle=Cycle(duty, 1e5)) == pytest.approx(
        float(steady_rise(network, heating, current)[0]), rel=1e-9
    )


def test_runaway_within_a_cycle() -> None:
    """A pause can hold back a current that would run away, a longer on phase cannot."""
    network, heating = two_nodes(), Heating(1.0)
    current = 1.2 * runaway_current(network, heating)
    assert peak_rise(network, heating, current, cycle=Cycle(0.2, 60.0)) < 1000
    assert peak_rise(network, heating, current, cycle=Cycle(0.9, 60.0)) == math.inf
    assert peak_rise(network, heating, current, cycle=Cycle(0.9)) == math.inf
    assert peak_rise(network, heating, 1e4, cycle=Cycle(0.9, 1e6)) == math.inf


def test_time_constants() -> None:
    assert one_node().time_constants == pytest.approx([100.0])
    network = two_nodes()
    inverse = np.linalg.inv(network.conductance / network.capacity[:, None])
    assert sorted(network.time_constants) == pytest.approx(sorted(np.linalg.eigvals(inverse).real), rel=1e-9)


def test_cycles_that_are_none() -> None:
    for duty in (0.0, 1.1, float("nan")):
        with pytest.raises(InputError, match="a duty of"):
            Cycle(duty)
    for period in (0.0, math.inf, float("nan")):
        with pytest.raises(InputError, match="a period of"):
            Cycle(0.5, period)
    unknown = one_node(capacity=float("nan"))
    with pytest.raises(InputError, match="heat capacity is not known"):
        peak_rise(unknown, Heating(1.0), 1.0, cycle=Cycle(0.5, 10.0))
    assert peak_rise(unknown, Heating(1.0), 1.0, cycle=Cycle(0.5)) > 0
