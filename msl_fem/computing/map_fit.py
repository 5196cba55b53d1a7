"""Maximum a posteriori fit of a simulation to data by Gauss-Newton, in units of what was believed before.

Minimised is S = |r(z)|^2/2 + |z|^2/2 with residuals r in units of their noise and parameters z in units of their
prior's sigma, counted from the belief. Damping is in the same metric (Levenberg 1944, Marquardt 1963): (J'J + (1 + mu)
I) d = -(J'r + z). The log evidence is Laplace's approximation (MacKay, Information Theory, Inference, and Learning
Algorithms, 2003, ch. 27): -S - log det(J'J + I)/2, up to a constant that all models of the same data share. It contains
the Occam factor.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from msl_fem.errors import ComputationError

Array = NDArray[np.float64]
Simulator = Callable[[Array], Array]
"""Parameters (n_lane, n_parameter) in units of their prior to residuals (n_lane, n_residual), nan of a failed run."""


@dataclass(frozen=True)
class FitSettings:
    """How the search goes.

    Attributes
    ----------
    step : of the differences, in units of the prior's sigma
    damping : the first mu
    enough : a predicted decrease of S, in nats, at which the fit has converged
    most_steps : accepted or not
    """

    step: float = 1e-3
    damping: float = 1e3
    enough: float = 1e-2
    most_steps: int = 60


@dataclass(frozen=True, eq=False)
class MapFit:
    """Where the search ended.

    Attributes
    ----------
    parameters : (n_parameter,) in units of the prior's sigma, from the belief
    covariance : (n_parameter, n_parameter) of them, (J'J + I)^-1
    residual : (n_residual,) at the end
    jacobian : (n_residual, n_parameter) there
    objective : S
    log_evidence : up to a constant of the data
    converged : the predicted decrease fell below what is enough
    simulations : single runs of the simulator
    reason : how it ended, in words
    """

    parameters: Array
    covariance: Array
    residual: Array
    jacobian: Array
    objective: float
    log_evidence: float
    converged: bool
    simulations: int
    reason: str


def fit_map(simulate: Simulator, start: Array, *, settings: FitSettings | None = None) -> MapFit:
    """The parameters of highest posterior density next to a start, (n_parameter,) in units of the prior.

    Raises
    ------
    ComputationError : the simulation fails at the start, or at a difference of it to both sides
    """
    how = settings or FitSettings()
    z = np.array(start, dtype=float)
    residual = simulate(z[None])[0]
    if not np.isfinite(residual).all():
        raise ComputationError("the simulation fails at the start of the fit; begin nearer to what was measured")
    simulations, damping, decrease = 1, how.damping, np.inf
    jacobian, cost = differences(simulate, z, residual, how.step), _objective(residual, z)
    simulations += z.size
    reason, converged = f"no end after {how.most_steps} steps", False
    for _ in range(how.most_steps):
        gram, slope = jacobian.T @ jacobian, jacobian.T @ residual + z
        full = np.linalg.solve(gram + np.eye(z.size), -slope)
        decrease = float(-slope @ full / 2)
        if decrease < how.enough:
            reason, converged = f"a further step would gain {decrease:.2g} nats", True
            break
        move = np.linalg.solve(gram + (1 + damping) * np.eye(z.size), -slope)
        trial = simulate((z + move)[None])[0]
        simulations += 1
        wanted = _objective(trial, z + move)
        if np.isfinite(wanted) and wanted < cost:
            z, residual, cost = z + move, trial, wanted
            damping = damping / 10 if damping > 1e-6 else 0.0
            jacobian = differences(simulate, z, residual, how.step)
            simulations += z.size
        elif damping > 1e12:
            reason = "no step makes it better"
            break
        else:
            damping = max(10 * damping, 1e-3)
    precision = jacobian.T @ jacobian + np.eye(z.size)
    return MapFit(
        parameters=z,
        covariance=np.asarray(np.linalg.inv(precision), dtype=np.float64),
        residual=residual,
        jacobian=jacobian,
        objective=cost,
        log_evidence=-cost - float(np.linalg.slogdet(precision)[1]) / 2,
        converged=converged,
        simulations=simulations,
        reason=reason,
    )


def differences(simulate: Simulator, z: Array, residual: Array, step: float) -> Array:
    """The Jacobian (n_residual, n_parameter) by one-sided differences; backwards where a run ahead fails.

    Raises
    ------
    ComputationError : the runs to both sides of a parameter fail
    """
    size = np.full(z.size, step)
    moved = simulate(z + np.diag(size))
    failed = ~np.isfinite(moved).all(axis=1)
    if failed.any():
        size[failed] = -step
        moved[failed] = simulate(z + np.diag(size)[failed])
        failed = ~np.isfinite(moved).all(axis=1)
    if failed.any():
        raise ComputationError(
            f"the simulation fails to both sides of parameter number {int(np.argmax(failed))}; take a shorter run or a "
            "smaller amplitude"
        )
    return np.asarray(((moved - residual) / size[:, None]).T)


def _objective(residual: Array, z: Array) -> float:
    return float(residual @ residual + z @ z) / 2
