"""A start from a controller's behaviour: its actions and returns are fitted before the agent learns by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np
import torch
from scipy.signal import lfilter

from auv_gym.rl.agents import action_scale_of, frames_of
from auv_gym.rl.evaluation import TRAINING, Agent, fresh_seeds
from auv_gym.rl.hyperparameters import Imitation
from auv_gym.rl.settings import Training, make_env

_BATCH = 512
_RATE = 1e-3
_SETTLED = 1e12  # number of observations, beside which those of a training are negligible
_DEPENDENT = 1e-6  # of the largest singular value: smaller ones are below the single precision of observations
_HORIZONS = 2.0  # horizons of the discount before an episode's end, where returns miss too many future rewards


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """Observations (N, n), the controller's actions (N, m), rewards (N,), and the steps of each episode.

    Rows of an episode are consecutive.  terminated: whether it ended early, so that no rewards would have followed.
    """

    observations: np.ndarray
    actions: np.ndarray
    rewards: np.ndarray
    lengths: tuple[int, ...]
    terminated: tuple[bool, ...]

    def episodes(self, rows: np.ndarray) -> list[np.ndarray]:
        """The rows of each episode."""
        return np.split(rows, np.cumsum(self.lengths)[:-1])


def teacher_of(training: Training, imitation: Imitation) -> tuple[Any, Agent]:
    """The environment of a training and the controller in it; raises if there is no such controller."""
    from controllers.piloting import pilot_for

    env = make_env(training.env, training.on, **training.learning_options)
    return env, pilot_for(env, imitation.controller)


def imitate(agent: Any, training: Training, imitation: Imitation, progress: Callable[[float], Any]) -> None:
    """Fit the actions and values of an untrained PPO agent to demonstrations.

    progress: called with the completed share.
    """
    env, pilot = teacher_of(training, imitation)
    rng = np.random.default_rng([training.seed, TRAINING])
    shown = demonstrate(pilot, env, imitation, fresh_seeds(training.seed, imitation.episodes, TRAINING), rng, progress)
    _normalise(agent, shown)
    follow(agent, shown, imitation.passes, rng)


def freeze_action_network(agent: Any, held: bool) -> None:
    """Let a PPO agent learn only values, or both again."""
    policy = agent.policy
    acting = [*policy.mlp_extractor.policy_net.parameters(), *policy.action_net.parameters(), policy.log_std]
    for parameter in acting:
        parameter.requires_grad_(not held)
        if held:
            parameter.grad = None  # else the last gradient would be applied again


def demonstrate(
    pilot: Agent, env: Any, imitation: Imitation, seeds: list[int], rng: np.random.Generator, progress: Callable
) -> Demonstrations:
    """Record the pilot in episodes, its actions offset so that it visits states where an agent may err."""
    observations, actions, rewards, lengths, ends = [], [], [], [], []
    for done, seed in enumerate(seeds):
        observation, info = env.reset(seed=seed)
        act = pilot.begin(env)
        size, offset = rng.uniform(0.0, imitation.noise), np.zeros(env.action_space.shape)
        steps, terminated, truncated = 0, False, False
        while not (terminated or truncated):
            if rng.random() * imitation.hold < 1.0:
                offset = size * rng.standard_normal(offset.shape)
            wanted = np.clip(act(observation, info), -1.0, 1.0)
            observations.append(observation)
            actions.append(wanted)
            moved = np.clip(wanted + offset, -1.0, 1.0).astype(env.action_space.dtype)
            observation, reward, terminated, truncated, info = env.step(moved)
            rewards.append(float(reward))
            steps += 1
        lengths.append(steps)
        ends.append(bool(terminated))
        progress((done + 1) / len(seeds))
    return Demonstrations(np.array(observations), np.array(actions), np.array(rewards), tuple(lengths), tuple(ends))


def returns_to_come(shown: Demonstrations, discount: float) -> np.ndarray:
    """The discounted sum of rewards from each row on, (N,); NaN near an end set only by the time limit."""
    found = [_discounted(part[::-1], discount)[::-1] for part in shown.episodes(shown.rewards)]
    left_out = ceil(_HORIZONS / max(1.0 - discount, 1e-3))
    for part, terminated in zip(found, shown.terminated, strict=True):
        if not terminated:
            part[max(len(part) - left_out, len(part) // 4) :] = np.nan
    return np.concatenate(found)


def follow(agent: Any, shown: Demonstrations, passes: int, rng: np.random.Generator) -> None:
    """Fit mean actions and values to the demonstrations by least squares, in passes over them in random order."""
    policy, normalizer = agent.policy, agent.get_vec_normalize_env()
    observations, values = shown.observations, returns_to_come(shown, agent.gamma)
    wanted = shown.actions / action_scale_of(agent)
    if normalizer is not None:
        observations = normalizer.normalize_obs(observations)
        if normalizer.norm_reward:
            values = values / np.sqrt(normalizer.ret_rms.var + normalizer.epsilon)
    seen = [_stacked(part, frames_of(agent)) for part in shown.episodes(observations)]
    observations = np.concatenate(seen)
    rows, actions, targets = (
        torch.as_tensor(np.asarray(a), dtype=torch.float32) for a in (observations, wanted, values)
    )
    noise = policy.log_std
    optimizer = torch.optim.Adam([p for p in policy.parameters() if p is not noise], lr=_RATE)
    for each in range(passes):
        for group in optimizer.param_groups:
            group["lr"] = _RATE * (1.0 - each / passes)
        order = torch.as_tensor(rng.permutation(len(rows)))
        for picked in order.split(_BATCH):
            acting, judging = policy.mlp_extractor(rows[picked])
            known = torch.isfinite(targets[picked])
            loss = torch.mean((policy.action_net(acting) - actions[picked]) ** 2)
            if known.any():
                worth = policy.value_net(judging).squeeze(1)[known]
                loss = loss + torch.mean((worth - targets[picked][known]) ** 2)
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
    if not len(policy.mlp_extractor.policy_net):  # a linear policy: the best gains are known in closed form
        known = np.column_stack([rows.numpy(), np.ones(len(rows))])
        *gains, offset = np.linalg.lstsq(known, wanted, rcond=_DEPENDENT)[0]
        with torch.no_grad():
            policy.action_net.weight.copy_(torch.as_tensor(np.array(gains).T))
            policy.action_net.bias.copy_(torch.as_tensor(offset))


def _normalise(agent: Any, shown: Demonstrations) -> None:
    """Initialise the scaling of observations and rewards from the demonstrations, and fix that of the observations."""
    normalizer = agent.get_vec_normalize_env()
    if normalizer is None:
        return
    if normalizer.norm_obs:
        normalizer.obs_rms.update(shown.observations)
        normalizer.obs_rms.count = _SETTLED  # another scaling would change the policy
    if normalizer.norm_reward:
        running = [_discounted(part, agent.gamma) for part in shown.episodes(shown.rewards)]
        normalizer.ret_rms.update(np.concatenate(running))


def _stacked(rows: np.ndarray, frames: int) -> np.ndarray:
    """Each row of an episode after the preceding ones, as the agent sees them; 0 before the start."""
    padded = np.concatenate([np.zeros_like(rows, shape=(frames - 1, rows.shape[1])), rows])
    return np.concatenate([padded[k : k + len(rows)] for k in range(frames)], axis=1)


def _discounted(rewards: np.ndarray, discount: float) -> np.ndarray:
    """The sum of each reward and the earlier ones, discounted once for each step back."""
    return np.asarray(lfilter([1.0], [1.0, -discount], rewards))
