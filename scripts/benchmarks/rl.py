"""Learning speed of an agent in our environments, compared with the same agent in Gymnasium's pendulum."""

from __future__ import annotations

import argparse
from time import perf_counter
from typing import Any

import numba
from rich.progress import Progress

from auv_gym.extra import needs
from auv_gym.rl import Training

TASK, PEER = "auv_gym/Depth-v0", "Pendulum-v1"
COUNTS, PEER_COUNT = (8, 64), 8
# one agent for all, as in RL Zoo's entry of the pendulum except for the network size, with as many steps an update
AGENT: dict[str, Any] = {
    "batch_size": 512,
    "n_epochs": 10,
    "normalize": True,
    "learning_rate": 1e-3,
    "policy_kwargs": {"net_arch": [64, 64]},
}
STEPS_AN_UPDATE = 2048


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options of this benchmark."""
    parser.add_argument("--steps", type=int, default=16_384, help="steps that each agent learns from (default: 16384)")
    parser.add_argument("--rounds", type=int, default=3, help="rounds of which the fastest counts (default: 3)")
    parser.add_argument("--seed", type=int, default=0, help="seed of the agents (default: 0)")


def measure(arguments: argparse.Namespace) -> dict[str, float]:
    """Steps per second of PPO, the share of the time that the environments take, and ratios; on one core.

    Every round runs everything once, one after the other, and each quantity's best round counts.
    """
    if arguments.steps < STEPS_AN_UPDATE or arguments.rounds < 1:
        raise ValueError(
            f"--steps needs {STEPS_AN_UPDATE} or more and --rounds 1 or more, got {arguments.steps} and "
            f"{arguments.rounds}."
        )
    with needs("The benchmark needs stable-baselines3", "rl"):
        from auv_gym.rl.agents import make_agent
    threads = numba.get_num_threads()
    numba.set_num_threads(1)  # the pendulum has one core too
    runs = {"pendulum_8": (PEER, PEER_COUNT)} | {f"depth_{count}": (TASK, count) for count in COUNTS}
    best: dict[str, tuple[float, float]] = {}
    try:
        with Progress(transient=True) as progress:
            task = progress.add_task("PPO", total=(arguments.rounds + 1) * len(runs))
            for number in range(arguments.rounds + 1):  # the first compiles
                for name, (env, count) in runs.items():
                    chosen = {
                        **AGENT,
                        "n_timesteps": arguments.steps,
                        "n_envs": count,
                        "n_steps": STEPS_AN_UPDATE // count,
                    }
                    agent, clock = make_agent(Training(env, seed=arguments.seed, hyperparameters=chosen))
                    steps = STEPS_AN_UPDATE if number == 0 else arguments.steps
                    began = perf_counter()
                    agent.learn(steps)
                    seconds = perf_counter() - began
                    found = (agent.num_timesteps / seconds, clock.taken() / seconds)
                    if number and found > best.get(name, (0.0, 0.0)):
                        best[name] = found
                    progress.advance(task)
    finally:
        numba.set_num_threads(threads)
    numbers = {f"{name}_steps_per_s": rate for name, (rate, _) in best.items()}
    numbers |= {f"{name}_share_of_time_in_env": share for name, (_, share) in best.items()}
    peer = best["pendulum_8"][0]
    return numbers | {f"depth_{count}_over_pendulum_8": best[f"depth_{count}"][0] / peer for count in COUNTS}
