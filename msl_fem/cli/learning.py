"""What `control --learn` tells: the condition, the trials on the plant, and what they gain on plants not seen."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from msl_fem.cli.output import progress_bar
from msl_fem.computing.arrays import Array
from msl_fem.control import ControllerDesign, PlantUnderTest
from msl_fem.control.closed_loop import ReferenceArrays
from msl_fem.control.learning import learn, learned_on_unseen_plants, learning_law, repeating
from msl_fem.control.scenario_response import scenarios_of
from msl_fem.control.unseen_plants import N_PLANT, DrawPlant
from msl_fem.errors import InputError

_SCENARIO_SEED = 2  # those that the band is chosen by are not those that the loop is judged on


@dataclass(frozen=True)
class Draws:
    """How plants beside the believed one are drawn, and what they have beside their tolerances."""

    draw: DrawPlant
    suspects: tuple[str, ...]


def check_learning(track: ReferenceArrays, *, injected: bool) -> None:
    """InputError where there is nothing that repeats."""
    if injected:
        raise InputError("--learn is for a reference that repeats; leave it out beside --inject")
    repeating(track)


def learned_reference(
    controller: ControllerDesign, track: ReferenceArrays, plant: PlantUnderTest, draws: Draws, *, trials: int,
    unseen: int, seed: int,
) -> tuple[Array, dict[str, Any]]:  # fmt: skip
    """(rows (n, 6) of the reference as learned on the plant, what is told of it)."""
    amplitude = 0.5 * float(np.ptp(track.position))
    plants = [draws.draw(np.random.default_rng([_SCENARIO_SEED, k])) for k in range(N_PLANT)]
    law = learning_law(controller, repeating(track), scenarios_of(controller, plants, amplitude=amplitude))
    generator = np.random.default_rng(seed)
    found = learn(controller, track, law, plant=plant, trials=trials, generator=generator)
    fields = found.to_json()
    if unseen:
        with progress_bar("learning on unseen plants") as progress:
            before, after = learned_on_unseen_plants(
                controller, track, law, draws.draw, trials=trials, n=unseen, suspects=draws.suspects, progress=progress
            )
        fields |= {"unseen": {"without": before.to_json(), "learned": after.to_json()}}
    return found.rows, fields
