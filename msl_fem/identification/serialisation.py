"""The identified model as a plain dictionary for JSON, and back."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from msl_fem.errors import InputError
from msl_fem.identification.armax_model import ArmaxModel
from msl_fem.identification.gauss_newton import Convergence
from msl_fem.identification.polynomials import ArmaxOrders, Polynomials
from msl_fem.identification.rational import RationalInputs, rational_term

SCHEMA = 1


def model_to_json(model: ArmaxModel) -> dict[str, Any]:
    """The model as numbers, texts, lists and dictionaries; `parameters` holds each value with its standard error."""
    polynomials, rational = model.polynomials, model.rational
    values = zip(model.parameters.tolist(), model.standard_errors.tolist(), strict=True)
    return {
        "schema": SCHEMA,
        "kind": "armax",
        "orders": asdict(model.orders),
        "sampling_period_s": model.sampling_period,
        "inputs": list(model.input_names),
        "a": polynomials.a.tolist(),
        "b": [b.tolist() for b in polynomials.b],
        "c": polynomials.c.tolist(),
        "offset": polynomials.offset,
        "parameters": {
            name: {"value": value, "standard_error": error}
            for name, (value, error) in zip(model.parameter_names, values, strict=True)
        },
        "covariance": model.covariance.tolist(),
        "noise_variance": model.noise_variance,
        "condition_number": model.condition_number,
        "input_condition_number": model.input_condition_number,
        "samples": model.n_samples,
        "convergence": asdict(model.convergence),
        "rational": None
        if rational is None
        else {
            "terms": [str(term) for term in rational.terms],
            "nominal_gap_m": rational.nominal_gap,
            "delta_m": rational.delta,
            "plain": list(rational.plain),
        },
        "input_slopes": list(model.input_slopes),
        "notes": list(model.notes),
    }


def model_from_json(document: Mapping[str, Any]) -> ArmaxModel:
    """The model that `model_to_json` wrote; InputError that names what is missing or not understood."""
    if document.get("kind") != "armax" or document.get("schema") != SCHEMA:
        raise InputError(
            f"kind {document.get('kind')!r}, schema {document.get('schema')!r}: expected an 'armax' model of schema "
            f"{SCHEMA}; identify it anew"
        )
    try:
        return _model(document)
    except KeyError as error:
        raise InputError(f"the model lacks the field {error.args[0]!r}: identify it anew") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"the model holds a field of the wrong kind ({error}): identify it anew") from error


def _model(document: Mapping[str, Any]) -> ArmaxModel:
    orders, trail, rational = document["orders"], document["convergence"], document["rational"]
    return ArmaxModel(
        orders=ArmaxOrders(
            orders["na"], tuple(orders["nb"]), orders["nc"], tuple(orders["nk"]), orders["offset"]
        ).for_inputs(len(document["inputs"])),
        polynomials=Polynomials(
            np.array(document["a"], dtype=float),
            tuple(np.array(b, dtype=float) for b in document["b"]),
            np.array(document["c"], dtype=float),
            float(document["offset"]),
        ),
        input_names=tuple(document["inputs"]),
        sampling_period=float(document["sampling_period_s"]),
        parameter_names=tuple(document["parameters"]),
        covariance=np.array(document["covariance"], dtype=float),
        noise_variance=float(document["noise_variance"]),
        condition_number=float(document["condition_number"]),
        input_condition_number=float(document["input_condition_number"]),
        n_samples=int(document["samples"]),
        convergence=Convergence(
            trail["converged"], trail["reason"], trail["start"], tuple(trail["costs"]), tuple(trail["step_lengths"])
        ),
        rational=None
        if rational is None
        else RationalInputs(
            tuple(rational_term(text) for text in rational["terms"]),
            float(rational["nominal_gap_m"]),
            float(rational["delta_m"]),
            tuple(rational["plain"]),
        ),
        input_slopes=tuple(map(float, document.get("input_slopes", ()))),
        notes=tuple(document["notes"]),
    )
