"""Plants for the tests of the coupled model, and its equations once more: slow, plain, by an adaptive integrator."""

import numpy as np
from scipy.integrate import solve_ivp

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.energy import energy_audit
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.layout import initial_state
from msl_fem.plant.plant import PlantParameters, plant_parameters, surface_of
from msl_fem.plant.preparation import effect_coefficients, start_effects
from msl_fem.plant.simulate import integrate
from msl_fem.table.magnetic_table import MagneticTable
from msl_fem.table.pair_surface import CORNERS, SharedCoenergy, fit_pair_surface

MUTUAL = 4e-4  # H, of one magnet of each side


def changed(actuator: Actuator, **sections: dict[str, object]) -> Actuator:
    """The actuator with keys of its sections replaced."""
    update = {name: getattr(actuator, name).model_copy(update=keys) for name, keys in sections.items()}
    return actuator.model_copy(update=update)


def locked(actuator: Actuator) -> Actuator:
    """The actuator with a mover that nothing moves."""
    return changed(actuator, motion={"moving_mass": 1e16})


def mass_and_spring(**drive: str) -> Actuator:
    """A mass on a spring that a force drives."""
    return parse_actuator({
        "schema": 1, "name": "rig", "drive": {"kind": "force", **drive},
        "motion": {"moving_mass": "0.5 kg", "stiffness": "2000 N/m", "damping": "8 N s/m"},
    })  # fmt: skip


def linear_table() -> MagneticTable:
    """A magnet without saturation, W' = L i^2/2 with L = a/(g + b); 0.6 mm is a node, so there it is exact."""
    gap, current = np.r_[np.geomspace(1e-4, 6e-4, 12), np.linspace(6.5e-4, 1.2e-3, 10)], np.linspace(0.0, 12.0, 7)
    i, g = np.meshgrid(current, gap)
    ind, ind_g, ind_gg = 1.08e-5 / (g + 3e-5), -1.08e-5 / (g + 3e-5) ** 2, 2.16e-5 / (g + 3e-5) ** 3
    nodes = {
        "coenergy": ind * i**2 / 2, "flux_linkage": ind * i, "force": -ind_g * i**2 / 2,
        "incremental_inductance": ind, "force_current_slope": -ind_g * i, "force_gap_slope": -ind_gg * i**2 / 2,
    }  # fmt: skip
    return MagneticTable(gap, current, nodes)


def reference_run(actuator: Actuator, table: MagneticTable, inputs: Inputs) -> dict[str, np.ndarray]:
    """The run of a current drive with bandwidth, two sides in series, from rest at x = 0, by DOP853.

    Restarted at every sample, and written from the equations alone; the mean voltage is an integral beside the state.
    """
    p = plant_parameters(actuator)
    n = p.magnets

    def side(i: float, g: float, g_rate: float, command: float) -> tuple[float, float, float]:
        magnet = table.evaluate(i, g)
        inductance, flux_gap_slope = n * magnet["incremental_inductance"], -n * magnet["force_current_slope"]
        voltage = p.resistance * i + flux_gap_slope * g_rate + inductance * p.bandwidth * (command - i)
        voltage = float(np.clip(voltage, -p.voltage_limit, p.voltage_limit))
        return (
            float((voltage - p.resistance * i - flux_gap_slope * g_rate) / inductance),
            n * float(magnet["force"]),
            voltage,
        )

    def rate(_t: float, y: np.ndarray, command: np.ndarray, push: float) -> list[float]:
        i1, i2, x, v, sensed = y[:5]
        di1, f1, u1 = side(i1, p.nominal_gap - x, -v, command[0])
        di2, f2, u2 = side(i2, p.nominal_gap + x, v, command[1])
        a = (f1 - f2 + push + p.constant_force - p.damping * v - p.stiffness * x) / p.mass
        return [di1, di2, v, a, p.sensor_bandwidth * (x - sensed), u1, u2]

    y, rows, period = np.zeros(5), [], 1 / inputs.rate
    for command, push in zip(inputs.commands, np.asarray(inputs.disturbance), strict=True):
        end = solve_ivp(
            rate, (0, period), np.r_[y, 0, 0], method="DOP853", rtol=1e-11, args=(command, push),
            atol=[1e-11, 1e-11, 1e-15, 1e-12, 1e-15, 1e-12, 1e-12], max_step=period / 4,
        ).y[:, -1]  # fmt: skip
        rows.append(np.r_[y, end[5:] / period])
        y = end[:5]
    table_of_rows = np.array(rows)
    return {
        "current": table_of_rows[:, :2], "position": table_of_rows[:, 2], "velocity": table_of_rows[:, 3],
        "measured_position": table_of_rows[:, 4], "voltage": table_of_rows[:, 5:],
    }  # fmt: skip


def kernel_run(
    actuator: Actuator, table: MagneticTable, inputs: Inputs, effects: EffectValues | None = None, steps: int = 20,
    **numbers: float,
) -> tuple[np.ndarray, float, PlantParameters]:  # fmt: skip
    """(rows of the kernel, imbalance of its energies, plant) with further numbers of the plant."""
    plant, surface = plant_parameters(actuator)._replace(**numbers), surface_of(table)
    state, e = initial_state(plant, 0.0, 0.0, 0.0, 0.0), None
    if effects is not None:
        e = effect_coefficients(plant, surface, effects, step=1 / (inputs.rate * steps), n_step=steps)
        start_effects(surface, plant, e, state)
    start = state.copy()
    out = integrate(surface, plant, inputs, state=state, substeps=steps, effects=e)[1]
    assert len(out) == inputs.time.size
    return out, energy_audit(surface, plant, e, start=start, end=state).imbalance, plant


def shared_coenergy(shape: str, *, largest: float = 13.0) -> SharedCoenergy:
    """D = M i j, "constant"; or with a mutual flux that position and currents change, "curved"."""
    currents = np.linspace(-largest, largest, 9)
    axes = np.linspace(-5e-4, 5e-4, 5), currents, currents
    x, i, j = np.meshgrid(*axes, indexing="ij")
    one, none = np.ones(x.shape), np.zeros(x.shape)
    if shape == "constant":
        nodes = {"": i * j, "1": j, "2": i, "12": one, "x": none, "x1": none, "x2": none, "x12": none}
        return SharedCoenergy(fit_pair_surface(*axes, {name: MUTUAL * nodes[name] for name in CORNERS}), 1.2e-3)
    u, v, k = i / 10, j / 10, 2e6
    f, f_x = 1 - k * x**2 + 300 * x, 300 - 2 * k * x
    h, h_1, h_2, h_12 = (
        u * v - 0.2 * (u + v) ** 4 / 12,
        v - 0.2 * (u + v) ** 3 / 3,
        u - 0.2 * (u + v) ** 3 / 3,
        1 - 0.2 * (u + v) ** 2,
    )
    nodes = {"": f * h, "1": f * h_1 / 10, "2": f * h_2 / 10, "12": f * h_12 / 100}
    nodes |= {"x": f_x * h, "x1": f_x * h_1 / 10, "x2": f_x * h_2 / 10, "x12": f_x * h_12 / 100}
    return SharedCoenergy(fit_pair_surface(*axes, {name: 100 * MUTUAL * nodes[name] for name in CORNERS}), 1.2e-3)
