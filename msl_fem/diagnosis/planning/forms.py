"""The forms that a cause may have where it is fitted in another one's place: those that a diagnosis tries."""

from collections.abc import Iterator

from msl_fem.diagnosis.planning.expected import ExpectedCause
from msl_fem.diagnosis.variants import RecordFeatures, Variant, variants
from msl_fem.plant.effects import CATALOGUE
from msl_fem.plant.plant import PlantParameters


def forms_of(cause: ExpectedCause, features: RecordFeatures, plant: PlantParameters) -> tuple[ExpectedCause, ...]:
    """The cause as it is expected, and every other form of its effect in a plant, amounts at the size expected or else
    at the plant's scale; each also with the shape of one amount as far as it goes: a lag of many poles is nearly a
    delay."""
    found = [cause.of_amounts, *(_form(cause, variant) for variant in variants(cause.effect, features, plant))]
    every = [further for form in found for further in (form, *_ends(form))]
    kept: dict[tuple[tuple[str, float], ...], ExpectedCause] = {}
    for form in every:
        kept.setdefault(tuple(sorted(form.values.items())), form)
    return tuple(kept.values())


def _form(cause: ExpectedCause, variant: Variant) -> ExpectedCause:
    amounts = {}
    for one in variant.amounts:
        scale = one.size * CATALOGUE[one.effect].parameter(one.name).scale
        amounts[one.name] = cause.values.get(one.name) or scale
    return ExpectedCause(cause.effect, amounts | {one.name: one.centre for one in variant.shapes}, cause.source)


def _ends(form: ExpectedCause) -> Iterator[ExpectedCause]:
    for parameter in CATALOGUE[form.effect].parameters:
        if parameter.shape and parameter.belongs_to in form.values:
            for end in parameter.ends or parameter.bounds[1:]:
                yield ExpectedCause(form.effect, {**form.values, parameter.name: end}, form.source)
