"""The extended model once more: slow, plain, from the equations alone, by an adaptive integrator.

Every effect that is a smooth differential equation; the circuits by one linear system of all unknowns. What remembers
(hysteresis, friction), what acts between commands (delay, lag, slew) and what only reads has tests of its own.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from msl_fem.actuator import Actuator
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.excitation import Inputs
from msl_fem.plant.plant import plant_parameters
from msl_fem.table.magnetic_table import MagneticTable

SMOOTH = EffectValues({
    "gap_offset": {"offset": 1e-5, "centring": 5e-6},
    "early_saturation": {"knee_shift": 0.05, "low_field_current": 0.02, "knee_excess": 0.03},
    "fringing": {"growth": 30.0, "depth_error": 0.01, "turns_error": -0.01},
    "eddy_currents": {"time_constant": 3e-4},
    "cross_coupling": {"share": 0.04},
    "leakage_inductance": {"share_1": 0.05, "share_2": 0.08},
    "mutual_inductance": {"share": -0.03},
    "remanent_flux": {"current_1": 0.04, "current_2": -0.03, "halving_current": 0.5},
    "coil_heating": {"rise_per_joule": 0.05, "initial_rise": 0.02, "cooling_rate": 3.0},
    "thermal_history": {"rise_1": 0.03, "rise_2": -0.01, "settling_rate": 3.0},
    "amplifier_bandwidth": {"bandwidth_error": -0.2},
    "stiffness_nonlinearity": {"cubic": 5e11, "quadratic": 5e7},
    "squeeze_film": {"damping": 8.0},
    "structural_mode": {"mass_share": 0.1, "frequency": 300.0, "damping_ratio": 0.02},
    "flexure_relaxation": {"strength": 0.1, "time_constant": 0.01},
    "force_offset": {"force": 1.0},
    "support_compliance": {"compliance": 5e-8, "frequency": 400.0, "damping_ratio": 0.2},
    "periodic_disturbance": {
        "force_cosine": 0.5, "force_sine": -0.3, "third_cosine": 0.1, "third_sine": 0.2, "frequency": 70.0,
    },
})  # fmt: skip


def twin(actuator: Actuator, table: MagneticTable, inputs: Inputs, values: EffectValues) -> dict[str, np.ndarray]:
    """A run of two sides in series in current drive from rest: currents of the coils, flux, position, mean voltage."""
    p, get, n = plant_parameters(actuator), values.get, plant_parameters(actuator).magnets
    s = 1 + get("early_saturation", "knee_shift")
    turns = 1 + get("fringing", "turns_error")
    inductance_0 = n * float(table.evaluate(0.0, p.nominal_gap)["incremental_inductance"])
    eddy = get("eddy_currents", "time_constant") / inductance_0
    share = get("cross_coupling", "share")
    leak = inductance_0 * np.array([get("leakage_inductance", f"share_{j}") for j in (1, 2)])
    stray = np.diag(leak) + inductance_0 * get("mutual_inductance", "share") * (1 - np.eye(2))
    remanent = np.array([get("remanent_flux", f"current_{j}") for j in (1, 2)])
    mix = np.array([[1.0, share], [share, 1.0]])
    w = p.bandwidth * (1 + get("amplifier_bandwidth", "bandwidth_error"))
    mu, mode_w = get("structural_mode", "mass_share"), 2 * np.pi * get("structural_mode", "frequency")
    mode_c = 2 * get("structural_mode", "damping_ratio") * mode_w
    base_w = 2 * np.pi * get("support_compliance", "frequency")
    base_c = 2 * get("support_compliance", "damping_ratio") * base_w
    hum_w = 2 * np.pi * get("periodic_disturbance", "frequency")

    def magnet(u: float, g: float) -> tuple[float, float, float, float]:
        """(flux, force, dflux/du, dflux/dg) of a side whose coenergy is n (1 + d + f g)/s^2 W'(s turns u, g)."""
        at = table.evaluate(s * turns * u, g)
        depth = (1 + get("fringing", "depth_error") + get("fringing", "growth") * g) / s**2
        growth, scale = get("fringing", "growth") / s**2, s * turns
        return (
            n * depth * scale * float(at["flux_linkage"]),
            n * (depth * float(at["force"]) - growth * float(at["coenergy"])),
            n * depth * scale**2 * float(at["incremental_inductance"]),
            n * scale * (-depth * float(at["force_current_slope"]) + growth * float(at["flux_linkage"])),
        )

    def iron(flux: np.ndarray, kept: np.ndarray = remanent) -> np.ndarray:
        """What iron in series takes of a side's current, less what its remanence stands for."""
        at = flux / inductance_0
        low, knee = get("early_saturation", "low_field_current"), get("early_saturation", "knee_excess")
        series = low * at / (get("early_saturation", "low_field_width") + np.abs(at)) + knee * at**3
        return series - kept / (1 + (at / get("remanent_flux", "halving_current")) ** 2)

    def sides(y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(four values a side, gaps, their rates)."""
        base, base_rate = get("support_compliance", "compliance") * y[[8, 9]]
        x, v = y[2] - base, y[3] - base_rate
        offset, centring = get("gap_offset", "offset"), get("gap_offset", "centring")
        gaps = p.nominal_gap + offset + np.array([centring - x, -centring + x])
        return np.array([magnet(y[j], gaps[j]) for j in range(2)]), gaps, np.array([-v, v])

    def own_iron(u: float, j: int) -> float:
        gap = sides(np.zeros(14))[1][j]
        return float(iron(np.array(magnet(u, gap)[0] + leak[j] * u), remanent[j]))

    def circuits(y: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(coil currents, voltages, rates of the circuits' fluxes): six equations, six unknowns."""
        values_of, _, gap_rates = sides(y)
        ind, emf = values_of[:, 2] + leak, values_of[:, 3] * gap_rates
        linked = values_of[:, 0] + stray @ y[:2]
        resistance = p.resistance * (1 + y[10:12])
        # unknown i, v, E: mix i = u + iron + eddy E;  v = R i + mix E;  v = R i + emf + L w (command - i)
        one, none = np.eye(2), np.zeros((2, 2))
        matrix = np.block(
            [
                [mix, none, -eddy * one],
                [-np.diag(resistance), one, -mix],
                [-np.diag(resistance) + np.diag(ind * w), one, none],
            ]
        )
        found = np.linalg.solve(matrix, np.r_[y[:2] + iron(linked), np.zeros(2), emf + ind * w * command])
        return found[:2], found[2:4], found[4:]

    def rate(t: float, y: np.ndarray, command: np.ndarray, push: float) -> np.ndarray:
        values_of, gaps, gap_rates = sides(y)
        current, voltage, flux_rate = circuits(y, command)
        x, v, creep, mode, mode_v, base, base_v = y[2], y[3], y[4], y[6], y[7], y[8], y[9]
        pull = values_of[0, 1] - values_of[1, 1]
        film = get("squeeze_film", "damping") * np.sum((p.nominal_gap / gaps) ** 3) * gap_rates[1]
        spring = p.stiffness * x + get("stiffness_nonlinearity", "quadratic") * x**2
        spring += get("stiffness_nonlinearity", "cubic") * x**3
        spring += get("flexure_relaxation", "strength") * p.stiffness * (x - creep)
        hum = get("periodic_disturbance", "force_cosine") * np.cos(hum_w * t)
        hum += get("periodic_disturbance", "force_sine") * np.sin(hum_w * t)
        hum += get("periodic_disturbance", "third_cosine") * np.cos(3 * hum_w * t)
        hum += get("periodic_disturbance", "third_sine") * np.sin(3 * hum_w * t)
        outer = push + p.constant_force + get("force_offset", "force") + hum
        link = mu * p.mass * (mode_w**2 * mode + mode_c * mode_v)
        a = (pull - film + outer - p.damping * v - spring + link) / ((1 - mu) * p.mass)
        heat = get("coil_heating", "rise_per_joule") * p.resistance * (1 + y[10:12]) * current**2
        return np.r_[
            np.linalg.solve(np.diag(values_of[:, 2]) + stray, flux_rate - values_of[:, 3] * gap_rates),
            v, a, (x - creep) / get("flexure_relaxation", "time_constant"), 0.0,
            mode_v, -a - mode_w**2 * mode - mode_c * mode_v,
            base_v, base_w**2 * (-(pull - film) - base) - base_c * base_v,
            heat - get("coil_heating", "cooling_rate") * y[10:12], voltage,
        ]  # fmt: skip

    y, rows, period, before = np.zeros(14), [], 1 / inputs.rate, np.zeros(2)
    for j in range(2):  # without a current of the coil, with the side's own flux
        y[j] = brentq(lambda u, j=j: u + own_iron(u, j), -1.0, 1.0, xtol=1e-15)
    y[10:12] = [get("coil_heating", "initial_rise") + get("thermal_history", f"rise_{j}") for j in (1, 2)]
    for k, (command, push) in enumerate(zip(inputs.commands, np.asarray(inputs.disturbance), strict=True)):
        current, flux = circuits(y, before)[0], mix @ (sides(y)[0][:, 0] + stray @ y[:2])
        end = solve_ivp(
            rate, (k * period, (k + 1) * period), np.r_[y[:12], 0, 0], method="DOP853", rtol=1e-10, atol=1e-13,
            args=(command, push), max_step=period / 2,
        ).y[:, -1]  # fmt: skip
        rows.append(np.r_[current, flux, y[2], y[3], end[12:] / period])
        y, before = end, command
    table_of_rows = np.array(rows)
    return {
        "current": table_of_rows[:, :2], "flux_linkage": table_of_rows[:, 2:4], "position": table_of_rows[:, 4],
        "velocity": table_of_rows[:, 5], "voltage": table_of_rows[:, 6:],
    }  # fmt: skip
