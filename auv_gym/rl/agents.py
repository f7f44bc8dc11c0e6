"""Agents of stable-baselines3 with their environments, and the networks in them as arrays. Needs the extra `rl`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium
import numba
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper, VecFrameStack, VecMonitor, VecNormalize
from torch import nn

from auv_gym.envs.stable_baselines import SingleEnvs, StableBaselinesVecEnv
from auv_gym.extra import needs
from auv_gym.rl.evaluation import TRAINING, fresh_seeds
from auv_gym.rl.policy import Policy, Scaling
from auv_gym.rl.settings import TRUE, Training, make_env

_LSTM_SIZE = 64  # size of the recurrent layer, like that of the hidden layers
_ACTIVATIONS: dict[str, type[nn.Module]] = {"tanh": nn.Tanh, "relu": nn.ReLU, "elu": nn.ELU}


class Clock(VecEnvWrapper):
    """A wrapper that measures the time that the environments take."""

    def __init__(self, venv: VecEnv):
        super().__init__(venv)
        self._seconds = 0.0

    def reset(self) -> Any:
        """Reset the environments, with time measured."""
        began = perf_counter()
        observations = self.venv.reset()
        self._seconds += perf_counter() - began
        return observations

    def step_async(self, actions: np.ndarray) -> None:
        """Start a step of the environments, with time measured."""
        began = perf_counter()
        self.venv.step_async(actions)
        self._seconds += perf_counter() - began

    def step_wait(self) -> Any:
        """Finish a step of the environments, with time measured."""
        began = perf_counter()
        found = self.venv.step_wait()
        self._seconds += perf_counter() - began
        return found

    def taken(self) -> float:
        """Seconds since the last call."""
        seconds, self._seconds = self._seconds, 0.0
        return seconds


class ScaledActions(VecEnvWrapper):
    """A wrapper that multiplies an agent's actions by `scale`, one number for all actions or one each."""

    def __init__(self, venv: VecEnv, scale: float | Sequence[float]):
        box = venv.action_space
        assert isinstance(box, gymnasium.spaces.Box)
        if np.size(scale) not in (1, *box.shape):
            raise ValueError(f"action_scale needs one number, or one for each of {box.shape[0]} actions, got {scale}.")
        self.scale = np.broadcast_to(np.asarray(scale, dtype=np.float32), box.shape)
        own = gymnasium.spaces.Box(box.low / self.scale, box.high / self.scale, dtype=np.float32)
        super().__init__(venv, action_space=own)

    def reset(self) -> Any:
        """Reset the environments."""
        return self.venv.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """Start a step of the environments with scaled actions."""
        self.venv.step_async(actions * self.scale)

    def step_wait(self) -> Any:
        """Finish a step of the environments."""
        return self.venv.step_wait()


def make_vector_env(env: str, count: int, on: Any = TRUE, **options: Any) -> VecEnv:
    """Environments in the form of stable-baselines3: the native vector environment, else single ones."""
    one = make_env(env, on, **options)  # also raises errors for wrong arguments
    spec = one.spec
    if spec is None or spec.vector_entry_point is None:
        return SingleEnvs([one, *(make_env(env, on, **options) for _ in range(count - 1))])
    if on != TRUE or not isinstance(on, str):
        options = {**options, "model": on}
    given = {name: value for name, value in options.items() if value is not None}
    return StableBaselinesVecEnv(
        gymnasium.make_vec(
            spec.id, num_envs=count, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **given
        )
    )


def make_agent(training: Training, tensorboard: Path | None = None, steps_before: int = 0) -> tuple[Any, Clock]:
    """The agent with its environments, and their clock; runs in one thread, on the CPU.

    steps_before: steps of a resumed training so far; its episodes and noise are drawn anew from there.
    """
    torch.set_num_threads(1)  # more threads slow down such small networks
    numba.set_num_threads(1)  # and some tens of vehicles, if other work keeps a core busy
    chosen = training.chosen
    clock = Clock(make_vector_env(training.env, chosen.n_envs, training.on, **training.learning_options))
    if not isinstance(clock.action_space, gymnasium.spaces.Box) or len(clock.observation_space.shape or ()) != 1:
        raise ValueError(
            f"Training needs observations in one row and actions that are numbers, got {clock.observation_space} and "
            f"{clock.action_space}."
        )
    envs: VecEnv = VecMonitor(clock)
    if chosen.action_scale != 1.0:
        envs = ScaledActions(envs, chosen.action_scale)
    normalizer = chosen.normalizer
    if normalizer is not None:
        envs = VecNormalize(envs, gamma=chosen.gamma, **normalizer.model_dump())
    if chosen.frame_stack > 1:
        envs = VecFrameStack(envs, chosen.frame_stack)
    seeds = fresh_seeds(training.seed + steps_before, chosen.n_envs, TRAINING)
    agent = _algorithm(chosen.recurrent)(
        chosen.policy,
        envs,
        learning_rate=_scheduled(chosen.learning_rate),
        clip_range=_scheduled(chosen.clip_range),
        policy_kwargs=_networks(training),
        tensorboard_log=None if tensorboard is None else str(tensorboard),
        seed=seeds[0],
        device="cpu",
        **chosen.agent_settings,
    )
    clock.venv._seeds = list(seeds)  # the constructor's seeds are consecutive
    return agent, clock


def policy_network(agent: Any) -> Policy:
    """The agent's noise-free policy as arrays, with the present scaling."""
    hidden = list(agent.policy.mlp_extractor.policy_net)
    linear = [part for part in (*hidden, agent.policy.action_net) if isinstance(part, nn.Linear)]
    names = [name for name, made in _ACTIVATIONS.items() if any(isinstance(part, made) for part in hidden)]
    memory = getattr(agent.policy, "lstm_actor", None)
    cell = () if memory is None else (memory.weight_ih_l0, memory.weight_hh_l0, memory.bias_ih_l0 + memory.bias_hh_l0)
    normalizer, scaling = agent.get_vec_normalize_env(), None
    if normalizer is not None and normalizer.norm_obs:
        moments: Any = normalizer.obs_rms
        scaling = Scaling(moments.mean.copy(), moments.var.copy(), normalizer.clip_obs, normalizer.epsilon)
    weights, biases = ([p.detach().numpy().copy() for p in of] for of in zip(*((q.weight, q.bias) for q in linear)))
    scale = action_scale_of(agent)
    weights[-1], biases[-1] = weights[-1] * np.reshape(scale, (-1, 1)), biases[-1] * scale
    return Policy(
        tuple(weights),
        tuple(biases),
        names[0] if names else "tanh",
        scaling,
        cell=tuple(part.detach().numpy().copy() for part in cell),
        frames=frames_of(agent),
    )


def frames_of(agent: Any) -> int:
    """The number of observations that the agent sees at once."""
    return agent.env.stacked_obs.n_stack if isinstance(agent.env, VecFrameStack) else 1


def action_scale_of(agent: Any) -> np.ndarray:
    """The scale of the agent's actions, (1,) if it is the same for all."""
    env = agent.env
    while isinstance(env, VecEnvWrapper):
        if isinstance(env, ScaledActions):
            return env.scale
        env = env.venv
    return np.ones(1, dtype=np.float32)


def _algorithm(recurrent: bool) -> Any:
    if not recurrent:
        return PPO
    with needs("Recurrent policies need sb3-contrib", "rl"):
        from sb3_contrib import RecurrentPPO
    return RecurrentPPO


def _networks(training: Training) -> dict[str, Any]:
    given: dict[str, Any] = training.chosen.policy_kwargs.model_dump(exclude_unset=True)
    if training.chosen.recurrent:
        given = {"lstm_hidden_size": _LSTM_SIZE, **given}
    given = {name: value for name, value in given.items() if value is not None}
    if "activation_fn" in given:
        given["activation_fn"] = _ACTIVATIONS[given["activation_fn"]]
    return given


def _scheduled(value: float | str) -> float | Callable[[float], float]:
    """The number, or a schedule that falls from it to 0 over the training."""
    if not isinstance(value, str):
        return value
    first = float(value.partition("_")[2])
    return lambda left: left * first
