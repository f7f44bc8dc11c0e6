"""A model in Python that drives an environment in place of its vehicle."""

from __future__ import annotations

from math import isfinite, nan

import numpy as np

from auv_gym.compiled import for_vector
from auv_gym.envs.episodes import Episodes
from auv_gym.envs.infos import Named
from auv_gym.envs.kernel.layout import RUNNING
from auv_gym.model import model_constant_inputs


class ModelDriver:
    """Steps a model between the compiled commands of an action and the compiled outcome, in an environment's row.

    The true states are taken from the model's states, or else from its outputs; others keep their value in the
    vehicle's cruise. States that the outputs do not show start as in cruise, if they have the names of a plant's
    states.
    """

    def __init__(self, episodes: Episodes, row: np.ndarray):
        self.model = model = episodes.driver
        family, state_at = episodes.plant.family, int(episodes.settings["state_at"])
        record = episodes.record(row)
        self._kernel, self._vector = episodes.kernel, episodes.vector
        self._command_one = for_vector(episodes.kernel.command_one)
        self._outcome_one = for_vector(episodes.kernel.outcome_one)
        self._raw, self._command = record["raw"], record["command"]
        self._true = row[state_at : state_at + len(family.states)]
        self._family = family
        self._outputs = [(family.outputs.index(n), i) for i, n in enumerate(model.outputs) if n in family.outputs]
        known = {name: (False, i) for i, name in enumerate(model.outputs)}
        known |= {name: (True, i) for i, name in enumerate(model.states)}
        self._truths = [(i, *known[name]) for i, name in enumerate(family.states) if name in known]
        at = len(family.states)
        self._start = row[state_at : state_at + at + len(family.actuators)]
        unseen = {name: i for i, name in enumerate(family.states) if name not in model.outputs}
        for name in model.states:
            for j, actuator in enumerate(family.actuators):
                if name in (f"{actuator} position", f"{actuator} play") or name.startswith(f"{actuator}["):
                    unseen[name] = at + j
        self._unseen = [(i, unseen[name]) for i, name in enumerate(model.states) if name in unseen]
        self._inputs = [(i, family.inputs.index(n)) for i, n in enumerate(model.inputs) if n in family.inputs]
        constants = model_constant_inputs(model)
        self._u = np.array([constants.get(name, 0.0) for name in model.inputs])
        self._names = {name: i for i, name in enumerate(model.states)}
        self.x = np.zeros(len(model.states))

    def begin(self, buffer: np.ndarray) -> int:
        """Start an episode, with the model starting from the vehicle's initial outputs; returns the status."""
        self._kernel.begin_one(self._vector, buffer)
        index = {name: i for i, name in enumerate(self._family.outputs)}
        start = np.array([self._raw[index[name]] if name in index else np.nan for name in self.model.outputs])
        self.x = np.array(self.model.initial(start), dtype=np.float64)
        for i, j in self._unseen:
            self.x[i] = self._start[j]
        self._put(self.x)
        self._kernel.look_one(buffer)
        return RUNNING

    def step(self, buffer: np.ndarray) -> int:
        """Advance the environment by one step; returns the status."""
        status = self._command_one(buffer)
        if status != RUNNING:
            return status
        for i, j in self._inputs:
            self._u[i] = self._command[j]
        x = np.asarray(self.model.step(self.x, self._u), dtype=np.float64)
        if self._put(x):
            self.x = x
        return self._outcome_one(buffer)

    def state(self) -> Named:
        """The model's state by name."""
        state = Named()
        state.index, state.numbers = self._names, self.x.tobytes()
        return state

    def _put(self, x: np.ndarray) -> bool:
        """Put the model's outputs and states into the row; if they are not finite, a diverged state."""
        # lists are faster than arrays for a few numbers
        states, outputs = x.tolist(), [nan]
        if all(map(isfinite, states)):
            outputs = np.asarray(self.model.output(x), dtype=np.float64).tolist()
        if not all(map(isfinite, outputs)):
            self._true[0] = nan
            return False
        for i, j in self._outputs:
            self._raw[i] = outputs[j]
        for i, among_states, j in self._truths:
            self._true[i] = states[j] if among_states else outputs[j]
        return True
