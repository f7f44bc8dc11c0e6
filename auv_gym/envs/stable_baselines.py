"""A gymnasium vector environment as the vector environment of stable-baselines3. Needs the extra `rl`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from auv_gym.extra import needs

with needs("The adapter needs stable-baselines3", "rl"):
    from stable_baselines3.common.vec_env import VecEnv


class StableBaselinesVecEnv(VecEnv):
    """The stable-baselines3 `VecEnv` of a vector environment that resets in the same step, for example

        gymnasium.make_vec("auv_gym/Depth-v0", num_envs=64, autoreset_mode="SameStep")

    The info of an environment that has ended is that of its last step, with `terminal_observation` and
    `TimeLimit.truncated`; those of the others are empty unless `step_infos` asks for them, as they cost more than the
    step.
    """

    def __init__(self, envs: gymnasium.vector.VectorEnv, *, step_infos: bool = False):
        mode = envs.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"stable-baselines3 needs environments that reset in the same step, got autoreset_mode {mode}: "
                "give autoreset_mode='SameStep' to gymnasium.make_vec."
            )
        self.envs, self.step_infos = envs, step_infos
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self._actions: np.ndarray | None = None

    def reset(self) -> np.ndarray:
        """First observations, shape (num_envs, ...), with seeds and options from `seed` and `set_options`."""
        options = [one or {} for one in self._options]
        if all(one == options[0] for one in options):
            observations, infos = self.envs.reset(seed=self._seeds, options=options[0])  # ty: ignore[invalid-argument-type]
        else:
            for i, one in enumerate(options):
                mask = np.arange(self.num_envs) == i
                observations, infos = self.envs.reset(
                    seed=self._seeds,  # ty: ignore[invalid-argument-type]
                    options={**one, "reset_mask": mask},
                )
        self.reset_infos = [_one_of(infos, i) for i in range(self.num_envs)]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, whether episodes have ended, and infos; ended environments have already restarted."""
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        ended = terminated | truncated
        found: list[dict[str, Any]] = [
            {"TimeLimit.truncated": False, **(_one_of(infos, i) if self.step_infos else {})}
            for i in range(self.num_envs)
        ]
        for i in np.flatnonzero(ended):
            found[i] = {
                **_one_of(infos["final_info"], i),
                "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                "terminal_observation": infos["final_obs"][i],
            }
            self.reset_infos[i] = _one_of(infos, i)
        return observations, rewards.astype(np.float32), ended, found

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of the vector environment, repeated for each index."""
        value = getattr(self.envs, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the vector environment; raises for a subset of its environments."""
        if indices is not None:
            raise ValueError(f"The environments are one object, so {attr_name!r} can be set for all of them only.")
        setattr(self.envs, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Raise always: the environments are one object, and have no methods of their own."""
        raise ValueError(f"The environments are one object and have no method {method_name!r} each: call it on `envs`.")

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """False for each index: wrap the vector environment as a whole, for example in VecMonitor(env)."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """None for each environment: a vector environment draws nothing."""
        return [None] * self.num_envs


class SingleEnvs(VecEnv):
    """Environments stepped one after another, for packages without a native vector environment.

    Similar to stable-baselines3's DummyVecEnv, which copies all infos in each step; here only the info of an
    environment that has ended is filled, and the others are empty.
    """

    def __init__(self, envs: Sequence[gymnasium.Env]):
        self.envs = list(envs)
        if not self.envs:
            raise ValueError("SingleEnvs needs at least one environment, got none.")
        super().__init__(len(self.envs), self.envs[0].observation_space, self.envs[0].action_space)
        self._actions: np.ndarray | None = None

    def reset(self) -> np.ndarray:
        """First observations, shape (num_envs, ...), with seeds and options from `seed` and `set_options`."""
        found = [
            env.reset(seed=seed, options=options or None)
            for env, seed, options in zip(self.envs, self._seeds, self._options, strict=True)
        ]
        self.reset_infos = [info for _, info in found]
        self._reset_seeds()
        self._reset_options()
        return np.stack([observation for observation, _ in found])

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Observations, rewards, whether episodes have ended, and infos; ended environments have already restarted."""
        if self._actions is None:
            raise ValueError("step_wait needs the actions of a step_async before it: call step.")
        observations, infos = [], []
        rewards, ended = np.empty(self.num_envs, np.float32), np.zeros(self.num_envs, bool)
        for i, (env, action) in enumerate(zip(self.envs, self._actions, strict=True)):
            observation, rewards[i], terminated, truncated, info = env.step(action)
            told: dict[str, Any] = {"TimeLimit.truncated": bool(truncated and not terminated)}
            ended[i] = terminated or truncated
            if ended[i]:
                told = {**info, **told, "terminal_observation": observation}
                observation, self.reset_infos[i] = env.reset()
            observations.append(observation)
            infos.append(told)
        return np.stack(observations), rewards, ended, infos

    def close(self) -> None:
        """Close the environments."""
        for env in self.envs:
            env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of each environment."""
        return [env.get_wrapper_attr(attr_name) for env in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of environments."""
        for env in self._chosen(indices):
            env.set_wrapper_attr(attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """The results of a method, called on each environment."""
        return [env.get_wrapper_attr(method_name)(*method_args, **method_kwargs) for env in self._chosen(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Whether each environment has a wrapper."""
        from stable_baselines3.common.env_util import is_wrapped

        return [is_wrapped(env, wrapper_class) for env in self._chosen(indices)]

    def get_images(self) -> Sequence[np.ndarray | None]:
        """The pictures of environments made with a render mode."""
        return [env.render() for env in self.envs]  # ty: ignore[invalid-explicit-return]

    def _chosen(self, indices: Any) -> list[gymnasium.Env]:
        return [self.envs[i] for i in self._get_indices(indices)]


def _one_of(infos: dict[str, Any], i: int | np.intp) -> dict[str, Any]:
    """The info of one environment, extracted from the infos of all."""
    found: dict[str, Any] = {}
    for name, values in infos.items():
        if name.startswith("_") or name in ("final_obs", "final_info") or not infos[f"_{name}"][i]:
            continue
        found[name] = _one_of(values, i) if isinstance(values, dict) else values[i]
    return found
