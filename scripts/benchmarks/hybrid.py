"""Time of an environment's step for a vehicle with a learned hull, compared with the hull's own coefficients."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.vector_env import TaskVectorEnv
from auv_gym.plant import Plant
from auv_gym.vehicles.body.learned_hull import LearnedHull
from identification.kernel_machines.machine import KernelMachine

TASK, STEPS, ROUNDS, MANY = "Depth", 500, 7, 64


def learned(plant: Plant, machine: KernelMachine) -> Plant:
    """The plant with a machine of its six forces, one RK4 step a sample."""
    sigma = np.array([machine.sigma])
    hull = LearnedHull(machine.support, machine.scale, sigma, machine.coefficients[None], machine.bias, 1.0)
    return replace(plant, learned=hull, longest_step=plant.dt)


def hybrid_rows(plant: Plant, full: KernelMachine, small: KernelMachine) -> list[dict[str, Any]]:
    """Time of a step, us, of single and vector environments by the source of the hull's forces."""
    whole, part = len(full.support), len(small.support)
    plants = {
        "coefficients, 5 RK4 steps a sample": plant,
        "coefficients, 1 RK4 step": replace(plant, longest_step=plant.dt),
        f"learned, {whole} centres, 1 RK4 step": learned(plant, full),
        f"learned, {part} centres, 1 RK4 step": learned(plant, small),
    }
    return [{"hull": name, "step_us": _single(one), "many_us": _many(one)} for name, one in plants.items()]


def _single(plant: Plant) -> float:
    env = TaskEnv(TASK, plant, duration=plant.dt * 2 * STEPS)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    times = []
    for _ in range(ROUNDS):
        env.reset(seed=0)
        env.step(action)
        began = time.perf_counter()
        for _ in range(STEPS):
            env.step(action)
        times.append((time.perf_counter() - began) / STEPS)
    return 1e6 * float(np.median(times))


def _many(plant: Plant) -> float:
    """Time of a step of one environment among many, on all cores."""
    env = TaskVectorEnv(TASK, MANY, plant, duration=plant.dt * 2 * STEPS)
    actions = np.zeros(env.action_space.shape or (), dtype=np.float32)
    env.reset(seed=0)
    env.step(actions)
    times = []
    for _ in range(ROUNDS):
        began = time.perf_counter()
        for _ in range(20):
            env.step(actions)
        times.append((time.perf_counter() - began) / (20 * MANY))
    return 1e6 * float(np.median(times))
