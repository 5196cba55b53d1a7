"""The effects of a plant as commands tell them: names in JSON, and for people what a name would hide."""

from msl_fem.plant.effects import CATALOGUE, EffectValues

READING = "position_sensor_nonlinearity"
GAIN = "gain_error"
FITTED_GAIN = "fitted gain of the position reading"


def effects_told(effects: EffectValues, *, as_json: bool) -> list[str]:
    """The names of the effects that are there.

    A diagnosis writes the position reading's fitted gain as `position_sensor_nonlinearity`; where nothing else of that
    effect is there, people read what it is: a gain within its tolerance, and no cause that was named.
    """
    if as_json or READING not in effects.present:
        return list(effects.present)
    others = [p.name for p in CATALOGUE[READING].parameters if p.name != GAIN]
    bent = any(effects.get(READING, name) != CATALOGUE[READING].parameter(name).neutral for name in others)
    return [FITTED_GAIN if name == READING and not bent else name for name in effects.present]
