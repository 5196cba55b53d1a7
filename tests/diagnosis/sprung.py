"""A mover on a spring that a force shakes, without a magnet: its motion in closed form, so that records cost little."""

import numpy as np
from scipy.linalg import expm

from msl_fem.actuator import Actuator, parse_actuator
from msl_fem.record import Noise, Record, Run, Sampling

RATE, N = 1000.0, 3000
MASS, DAMPING, STIFFNESS = 2.0, 40.0, 5e4
SIGMA = 2e-7


def shaker() -> Actuator:
    motion = {"moving_mass": f"{MASS} kg", "stiffness": f"{STIFFNESS} N/m", "damping": f"{DAMPING} N s/m"}
    return parse_actuator({"schema": 1, "name": "shaker", "motion": motion, "drive": {"kind": "force"}})


def motion_under(force: np.ndarray, *, damping: float = DAMPING, start: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    """(n_sample, 2) position and velocity under a held force."""
    step = expm(np.array([[0, 1, 0], [-STIFFNESS / MASS, -damping / MASS, 1 / MASS], [0, 0, 0]]) / RATE)
    found = np.zeros((force.size, 2))
    found[0] = start
    for n in range(force.size - 1):
        found[n + 1] = (step @ [*found[n], force[n]])[:2]
    return found


def damping_interval(force: np.ndarray, counted: np.ndarray) -> float:
    """N s/m, width of the 95 % interval of the damping that readings of the position at some samples leave in white
    noise, beside a free start: from the inverse of their information."""
    rest, moved = motion_under(force), motion_under(force, damping=DAMPING + 0.01)
    columns = [(moved - rest)[:, 0] / 0.01]
    columns += [(motion_under(force, start=start) - rest)[:, 0] for start in ((1.0, 0.0), (0.0, 1.0))]
    told = np.array(columns)[:, counted] / SIGMA
    return float(2 * 1.96 * np.sqrt(np.linalg.inv(told @ told.T)[0, 0]))


def shaken(name: str, role: str, seed: int) -> Run:
    rng = np.random.default_rng(seed)
    force = np.repeat(rng.choice([-4.0, 4.0], N // 20), 20)
    position, velocity = motion_under(force).T
    columns = {"time_s": np.arange(N) / RATE, "force_N": force, "position_m": position + SIGMA * rng.standard_normal(N)}
    return Run(name, "steps", role, columns, extra={"true_velocity": velocity})


def record() -> Record:
    runs = (shaken("a", "fit", 1), shaken("b", "held-out", 2))
    return Record("measured", shaker(), Sampling(rate=RATE), Noise(position=SIGMA), runs=runs)
