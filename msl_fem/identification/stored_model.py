"""What a stored model must hold so that its coefficients, names, covariance and inputs belong together."""

from collections.abc import Iterator

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.model import ArmaxEstimate


def check_stored(model: ArmaxEstimate) -> None:
    """InputError that names the first field that contradicts the others or that no model has."""
    for problem in _problems(model):
        raise InputError(problem)


def _problems(model: ArmaxEstimate) -> Iterator[str]:
    names = model.input_names
    if not all(isinstance(name, str) for name in names) or len(set(names)) != len(names):
        yield f"inputs {names!r} are no different names"
    if not (np.isfinite(model.sampling_period) and model.sampling_period > 0.0):
        yield f"sampling_period_s is {model.sampling_period!r}, it must be positive"
    if not model.noise_variance >= 0.0:
        yield f"noise_variance is {model.noise_variance!r}, it must be 0 or more"
    yield from _problems_of_coefficients(model)
    yield from _problems_of_covariance(model)
    rational = model.rational
    if rational is not None and (rational.input_names != names or not np.isfinite(rational.delta)):
        yield f"its rational terms are {', '.join(rational.input_names)}, its inputs {', '.join(names)}"
    if len(model.input_slopes) not in (0, len(names)) or not np.isfinite(model.input_slopes).all():
        yield f"input_slopes are {len(model.input_slopes)} numbers, there are {len(names)} inputs"


def _problems_of_coefficients(model: ArmaxEstimate) -> Iterator[str]:
    orders, polynomials = model.orders, model.polynomials
    if not isinstance(orders.offset, bool):
        yield f"orders.offset is {orders.offset!r}, it must be true or false"
    sizes = [("a", polynomials.a, orders.na + 1), ("c", polynomials.c, orders.nc + 1)]
    if len(polynomials.b) != len(model.input_names):
        yield f"b has {len(polynomials.b)} rows, there are {len(model.input_names)} inputs"
    sizes += [("b", b, len(lags)) for b, lags in zip(polynomials.b, orders.input_lags, strict=True)]
    for name, values, size in sizes:
        if values.shape != (size,) or not np.isfinite(values).all():
            yield f"{name} must be {size} finite numbers by the orders"
    if polynomials.a[0] != 1.0 or polynomials.c[0] != 1.0 or not np.isfinite(polynomials.offset):
        yield "a and c begin with 1, and the offset is a number"


def _problems_of_covariance(model: ArmaxEstimate) -> Iterator[str]:
    expected = model.orders.parameter_names(model.input_names)
    with_gap = (*expected, "delta") if model.rational is not None else expected
    if model.parameter_names not in (expected, with_gap):
        yield f"parameters must be {', '.join(expected)}"
    n = len(model.parameter_names)
    if model.covariance.shape != (n, n) or np.any(np.diag(model.covariance) < 0.0):
        yield f"covariance must be {n} by {n} numbers, none on the diagonal below 0"
