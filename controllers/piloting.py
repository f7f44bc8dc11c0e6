"""A controller that drives an environment, with the same interface as trained policies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from auv_gym.plant import without_effects
from controllers.allocation import AXES
from controllers.autopilots import LAWS, autopilot
from controllers.composed.loops import commanded_inputs
from controllers.controller import Controller
from controllers.kinds import KINDS

_WRENCH = {name.rpartition("_")[0]: name for name in AXES}  # actions of environments that are axes of a wrench


@dataclass(frozen=True)
class Pilot:
    """A controller in place of a policy: it acts on the readings and targets in the infos."""

    controller: Controller

    def begin(self, env: Any) -> Callable[[np.ndarray, Mapping[str, Any]], np.ndarray]:
        """Start an episode; returns the function from observation and info to action, see `rl.evaluation.Agent`."""
        inner: Any = env.unwrapped
        controller, memory = self.controller, self.controller.start()
        before: float | None = None

        def act(observation: np.ndarray, info: Mapping[str, Any]) -> np.ndarray:
            nonlocal memory, before
            time = info["time_s"]
            dt = info.get("dt_s", inner.plant.dt) if before is None else time - before
            command, memory = controller.act(memory, {**dict(info["reading"]), "dt_s": dt}, dict(info["target"]))
            before = time
            return inner.action_for({name: command[_commanded(name)] for name in inner.episodes.actions})

        return act


def pilot_for(env: Any, kind: str, **settings: Any) -> Pilot:
    """The autopilot of an environment's vehicle for the environment's target; raises if there is none.

    kind: "pid", "s_plane" (or "s-plane"), "gpc".  It knows the vehicle without its effects.  settings: as `autopilot`.
    If a vehicle cannot follow all parts of the target (for example pitch, if thrusters have no lever arm), it follows
    the others.

    Example:

        >>> import gymnasium
        >>> from controllers import pilot_for
        >>> env = gymnasium.make("auv_gym/GliderHeading-v0")
        >>> act = pilot_for(env, "pid").begin(env)
        >>> action = act(*env.reset(seed=0))
        >>> action.shape
        (1,)
    """
    kind = kind.replace("-", "_")
    inner: Any = env.unwrapped
    plant = getattr(inner, "plant", None)
    if plant is None:
        raise ValueError(f"{inner} has no vehicle, so no controller is known for it: leave out {kind}.")
    if kind not in LAWS:
        raise ValueError(f"No autopilot of kind {kind!r}. Kinds: {', '.join(LAWS)}.")
    layer = KINDS.of(plant.family)
    known = layer.followed
    _, info = env.reset(seed=0)
    targets = tuple(info["target"])
    if not targets or not set(targets) <= set(known):
        raise ValueError(
            f"No controller follows the target of this environment ({', '.join(targets) or 'a path'}); of "
            f"{plant.name} they follow {', '.join(known)}: compare in another environment."
        )
    able = known if layer.able is None else layer.able(plant)
    controller = autopilot(without_effects(plant), kind, [name for name in targets if name in able], **settings)
    given = (*commanded_inputs(controller), *getattr(controller, "adds", ()))
    missing = [name for name in inner.episodes.actions if _commanded(name) not in given]
    if missing:
        raise ValueError(
            f"The actions of this environment are {', '.join(inner.episodes.actions)}, and the controller of "
            f"{plant.name} commands {', '.join(commanded_inputs(controller))}: leave out actions=."
        )
    return Pilot(controller)


def _commanded(action: str) -> str:
    """The command of a controller for an action."""
    return _WRENCH.get(action, action)
