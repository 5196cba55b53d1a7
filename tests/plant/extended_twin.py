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


class Twin:
    """Two sides in series in current drive, at rest to begin with."""

    def __init__(self, actuator: Actuator, table: MagneticTable, values: EffectValues) -> None:
        self.p, self.table, self.get = plant_parameters(actuator), table, values.get
        get, n = values.get, self.p.magnets
        self.scale = 1 + get("early_saturation", "knee_shift")
        self.turns = 1 + get("fringing", "turns_error")
        self.inductance_0 = n * float(table.evaluate(0.0, self.p.nominal_gap)["incremental_inductance"])
        self.eddy = get("eddy_currents", "time_constant") / self.inductance_0
        share = get("cross_coupling", "share")
        self.mix = np.array([[1.0, share], [share, 1.0]])
        self.leak = self.inductance_0 * np.array([get("leakage_inductance", f"share_{j}") for j in (1, 2)])
        mutual = self.inductance_0 * get("mutual_inductance", "share")
        self.stray = np.diag(self.leak) + mutual * (1 - np.eye(2))
        self.remanent = np.array([get("remanent_flux", f"current_{j}") for j in (1, 2)])
        self.bandwidth = self.p.bandwidth * (1 + get("amplifier_bandwidth", "bandwidth_error"))

    def magnet(self, u: float, g: float) -> tuple[float, float, float, float]:
        """(flux, force, dflux/du, dflux/dg) of a side whose coenergy is n (1 + d + f g)/s^2 W'(s turns u, g)."""
        get, n, s = self.get, self.p.magnets, self.scale
        at = self.table.evaluate(s * self.turns * u, g)
        depth = (1 + get("fringing", "depth_error") + get("fringing", "growth") * g) / s**2
        growth, scale = get("fringing", "growth") / s**2, s * self.turns
        return (
            n * depth * scale * float(at["flux_linkage"]),
            n * (depth * float(at["force"]) - growth * float(at["coenergy"])),
            n * depth * scale**2 * float(at["incremental_inductance"]),
            n * scale * (-depth * float(at["force_current_slope"]) + growth * float(at["flux_linkage"])),
        )

    def iron(self, flux: np.ndarray, kept: np.ndarray) -> np.ndarray:
        """What iron in series takes of a side's current, less what its remanence stands for."""
        get, at = self.get, flux / self.inductance_0
        low, knee = get("early_saturation", "low_field_current"), get("early_saturation", "knee_excess")
        series = low * at / (get("early_saturation", "low_field_width") + np.abs(at)) + knee * at**3
        return series - kept / (1 + (at / get("remanent_flux", "halving_current")) ** 2)

    def sides(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(four values a side, gaps, their rates)."""
        compliance = self.get("support_compliance", "compliance")
        x, v = y[2] - compliance * y[8], y[3] - compliance * y[9]
        offset, centring = self.get("gap_offset", "offset"), self.get("gap_offset", "centring")
        gaps = self.p.nominal_gap + offset + np.array([centring - x, -centring + x])
        return np.array([self.magnet(y[j], gaps[j]) for j in range(2)]), gaps, np.array([-v, v])

    def linked(self, values_of: np.ndarray, y: np.ndarray) -> np.ndarray:
        """The flux linkages of both sides, of these values, leakage with them."""
        return values_of[:, 0] + self.stray @ y[:2]

    def at_rest(self) -> np.ndarray:
        """The state without a current of the coils, with the sides' own flux."""

        def own_iron(u: float, j: int) -> float:
            gap = self.sides(np.zeros(14))[1][j]
            flux = np.array(self.magnet(u, gap)[0] + self.leak[j] * u)
            return float(self.iron(flux, self.remanent[j]))

        y = np.zeros(14)
        for j in range(2):
            y[j] = brentq(lambda u, j=j: u + own_iron(u, j), -1.0, 1.0, xtol=1e-15)
        rises = [self.get("thermal_history", f"rise_{j}") for j in (1, 2)]
        y[10:12] = self.get("coil_heating", "initial_rise") + np.array(rises)
        return y

    def circuits(self, y: np.ndarray, command: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(coil currents, voltages, rates of the circuits' fluxes): six equations, six unknowns."""
        values_of, _, gap_rates = self.sides(y)
        mix, w = self.mix, self.bandwidth
        ind, emf = values_of[:, 2] + self.leak, values_of[:, 3] * gap_rates
        resistance = self.p.resistance * (1 + y[10:12])
        # unknown i, v, E: mix i = u + iron + eddy E;  v = R i + mix E;  v = R i + emf + L w (command - i)
        one, none = np.eye(2), np.zeros((2, 2))
        matrix = np.block(
            [
                [mix, none, -self.eddy * one],
                [-np.diag(resistance), one, -mix],
                [-np.diag(resistance) + np.diag(ind * w), one, none],
            ]
        )
        taken = self.iron(self.linked(values_of, y), self.remanent)
        found = np.linalg.solve(matrix, np.r_[y[:2] + taken, np.zeros(2), emf + ind * w * command])
        return found[:2], found[2:4], found[4:]

    def outer(self, t: float, y: np.ndarray, push: float) -> float:
        """The forces on the mover that are neither the magnets' nor of its second mass."""
        p, get, x = self.p, self.get, y[2]
        spring = p.stiffness * x + get("stiffness_nonlinearity", "quadratic") * x**2
        spring += get("stiffness_nonlinearity", "cubic") * x**3
        spring += get("flexure_relaxation", "strength") * p.stiffness * (x - y[4])
        w = 2 * np.pi * get("periodic_disturbance", "frequency")
        hum = get("periodic_disturbance", "force_cosine") * np.cos(w * t)
        hum += get("periodic_disturbance", "force_sine") * np.sin(w * t)
        hum += get("periodic_disturbance", "third_cosine") * np.cos(3 * w * t)
        hum += get("periodic_disturbance", "third_sine") * np.sin(3 * w * t)
        return float(push + p.constant_force + get("force_offset", "force") + hum - p.damping * y[3] - spring)

    def rate(self, t: float, y: np.ndarray, command: np.ndarray, push: float) -> np.ndarray:
        """Of the magnets' currents, position, velocity, creep, a second mass, the support, the heat of both sides, and
        the voltages' integrals."""
        p, get = self.p, self.get
        values_of, gaps, gap_rates = self.sides(y)
        current, voltage, flux_rate = self.circuits(y, command)
        x, v, creep, mode, mode_v, base, base_v = y[2], y[3], y[4], y[6], y[7], y[8], y[9]
        film = get("squeeze_film", "damping") * np.sum((p.nominal_gap / gaps) ** 3) * gap_rates[1]
        pull = values_of[0, 1] - values_of[1, 1] - film
        mu, mode_w = get("structural_mode", "mass_share"), 2 * np.pi * get("structural_mode", "frequency")
        carried = mode_w**2 * mode + 2 * get("structural_mode", "damping_ratio") * mode_w * mode_v
        base_w = 2 * np.pi * get("support_compliance", "frequency")
        base_c = 2 * get("support_compliance", "damping_ratio") * base_w
        a = (pull + self.outer(t, y, push) + mu * p.mass * carried) / ((1 - mu) * p.mass)
        heat = get("coil_heating", "rise_per_joule") * p.resistance * (1 + y[10:12]) * current**2
        return np.r_[
            np.linalg.solve(np.diag(values_of[:, 2]) + self.stray, flux_rate - values_of[:, 3] * gap_rates),
            v, a, (x - creep) / get("flexure_relaxation", "time_constant"), 0.0, mode_v, -a - carried,
            base_v, base_w**2 * (-pull - base) - base_c * base_v,
            heat - get("coil_heating", "cooling_rate") * y[10:12], voltage,
        ]  # fmt: skip


def twin(actuator: Actuator, table: MagneticTable, inputs: Inputs, values: EffectValues) -> dict[str, np.ndarray]:
    """A run of two sides in series in current drive from rest: currents of the coils, flux, position, mean voltage."""
    plant, rows, period, before = Twin(actuator, table, values), [], 1 / inputs.rate, np.zeros(2)
    y = plant.at_rest()
    for k, (command, push) in enumerate(zip(inputs.commands, np.asarray(inputs.disturbance), strict=True)):
        current, flux = plant.circuits(y, before)[0], plant.mix @ plant.linked(plant.sides(y)[0], y)
        end = solve_ivp(
            plant.rate, (k * period, (k + 1) * period), np.r_[y[:12], 0, 0], method="DOP853", rtol=1e-10, atol=1e-13,
            args=(command, push), max_step=period / 2,
        ).y[:, -1]  # fmt: skip
        rows.append(np.r_[current, flux, y[2], y[3], end[12:] / period])
        y, before = end, command
    table_of_rows = np.array(rows)
    return {
        "current": table_of_rows[:, :2], "flux_linkage": table_of_rows[:, 2:4], "position": table_of_rows[:, 4],
        "velocity": table_of_rows[:, 5], "voltage": table_of_rows[:, 6:],
    }  # fmt: skip
