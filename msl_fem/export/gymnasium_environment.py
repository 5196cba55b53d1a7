"""The levitated mover as an environment of Gymnasium, for learned controllers; the guard limits their commands."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from msl_fem.actuator import Actuator
from msl_fem.computing.arrays import Array
from msl_fem.errors import InputError
from msl_fem.maps import Guard, OperatingMap
from msl_fem.plant.effects import EffectValues
from msl_fem.plant.instruments import N_READING, reading_noise
from msl_fem.plant.layout import OK, X
from msl_fem.plant.sampled_plant import advance_sample, plant_at_rest, read_instruments, sampled_plant
from msl_fem.table.magnetic_table import MagneticTable

Observation = NDArray[np.float32]
LOST = -100.0
"""Reward of leaving the table or the travel."""


class LevitatedMover(gymnasium.Env[Observation, NDArray[np.float32]]):
    """A mover between its magnets, in current drive, that is to be brought to a target and held there.

    The action is a share 0 ... 1 of the largest current a side may have: the guard's last limit at the gap that the
    position sensor tells, the drive's limit where that is less. So no action is unacceptable by the map.

    The observation is (position, target, currents of the sides) as the instruments read them, each over its scale:
    `travel` m and `current_limit` A. The reward of a step is 1 - |position - target|/travel; an episode ends when the
    mover leaves the table or its travel (reward -100), and is truncated after `duration`.
    """

    def __init__(
        self,
        actuator: Actuator,
        table: MagneticTable,
        operating_map: OperatingMap,
        *,
        duration: float = 0.2,
        effects: EffectValues | None = None,
    ) -> None:
        """
        Parameters
        ----------
        duration : of an episode in s
        effects : that the plant has beside the plain model

        Raises
        ------
        InputError : the actuator has no current drive or no [controller], or the plant cannot have one of the effects
        """
        if actuator.drive is None or actuator.drive.kind != "current" or actuator.controller is None:
            raise InputError(f'{actuator.name}: the environment needs [controller] and [drive] with kind = "current"')
        self.actuator = actuator
        self.guard = Guard(operating_map)
        self.rate = actuator.controller.rate
        self._plant = sampled_plant(actuator, table, rate=self.rate, effects=effects)
        parameters = self._plant.parameters
        self.sides = parameters.sides
        self.travel = float(parameters.travel if np.isfinite(parameters.travel) else parameters.nominal_gap)
        stated = actuator.drive.current_limit
        most = table.current[-1] / parameters.current_share
        self.current_limit = float(most if stated is None else min(stated, most))
        self.steps = max(1, round(duration * self.rate))
        self.action_space = spaces.Box(0.0, 1.0, (self.sides,), np.float32)
        self.observation_space = spaces.Box(-np.inf, np.inf, (2 + self.sides,), np.float32)
        self._readings = np.zeros(N_READING)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """At rest where the suspension holds it, or at `options["position"]` (m).

        The target is `options["target"]` (m); without, it is drawn from the middle half of the travel.
        """
        super().reset(seed=seed)
        wished = options or {}
        self._state, self._history = plant_at_rest(self._plant, position=wished.get("position"))
        drawn = self.np_random.uniform(-0.5, 0.5) * self.travel if self.sides == 2 else 0.0
        self.target = float(wished.get("target", drawn))
        self._k = 0
        self._read()
        return self._observation(), {"position": float(self._state[X])}

    def step(self, action: NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """A period of the controller with the currents that the action asks for, held."""
        command = np.zeros(2)
        command[: self.sides] = np.clip(action, 0.0, 1.0) * self.limits()
        status = advance_sample(self._plant, self._state, command, 0.0, np.zeros(2))
        self._k += 1
        lost = status != OK
        if not lost:
            self._read()
        error = abs(float(self._state[X]) - self.target) / self.travel
        told = {"position": float(self._state[X]), "command": command[: self.sides].copy()}
        return self._observation(), LOST if lost else 1.0 - error, lost, self._k >= self.steps, told

    def limits(self) -> Array:
        """(n_side,) A: what each side may have at the gap that the position sensor tells; 0 outside the map."""
        p = self._plant.parameters
        towards = np.array([1.0, -1.0])[: self.sides]
        allowed = self.guard.limit(p.nominal_gap - towards * self._readings[0])[-1] / p.current_share
        return np.minimum(np.nan_to_num(allowed, nan=0.0), self.current_limit)

    def _read(self) -> None:
        noise = reading_noise(self.actuator, 1, generator=self.np_random)[0]
        read_instruments(self._plant, self._state, self._history, self._k, noise, self._readings)

    def _observation(self) -> Observation:
        currents = self._readings[1 : 1 + self.sides] / self.current_limit
        place = np.array([self._readings[0], self.target]) / self.travel
        return np.concatenate([place, currents]).astype(np.float32)
