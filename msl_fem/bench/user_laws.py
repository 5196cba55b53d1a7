"""Causes that users state, as effects that the bench can hide."""

from msl_fem.bench.law_program import with_law
from msl_fem.bench.rig import Rig
from msl_fem.bench.setting import BenchEffect, BenchSetting, RigWithEffect
from msl_fem.computing.laws import LawExpression


def effect_of_law(expression: LawExpression) -> BenchEffect:
    """A user's cause that can be hidden: its strength is the share of the amounts' ranges, or of their stated values.

    A shape that is not stated is drawn within its range.
    """

    def hide(setting: BenchSetting, rig: Rig, strength: float) -> RigWithEffect:
        generator = setting.generator(expression.effect)
        values = {}
        for p in expression.parameters:
            drawn = float(generator.random())
            if p.amount:
                values[p.name] = strength * (p.value or p.high or p.low)
            else:
                values[p.name] = p.low * (p.high / p.low) ** drawn if p.value is None else p.value
        return rig.with_parts(laws=with_law(rig.plant.laws, expression, values)), values

    magnets = expression.equation == "voltage" or bool(expression.variables & {"i1", "i2", "g1", "g2"})
    return BenchEffect(expression.effect, "share", "1", hide, lambda s: 0.1, lambda s: 1.0, needs_magnets=magnets)
