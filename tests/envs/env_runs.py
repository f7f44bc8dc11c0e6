"""Runs of environments that several of their tests are made of."""

import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[2]


class InPython:
    """A plant that the environments do not know as one."""

    def __init__(self, plant):
        self._plant = plant

    def __getattr__(self, name):
        return getattr(self._plant, name)


def go(env, action, steps):
    """Step an environment with one action, over the ends of its episodes."""
    for _ in range(steps):
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()


def memory_growth(env, action, steps):
    """Bytes that Python objects and arrays have grown by over many steps, after a first round of them."""
    env.reset(seed=0)
    go(env, action, 1000)
    tracemalloc.start()
    go(env, action, 1000)
    before, _ = tracemalloc.get_traced_memory()
    go(env, action, steps)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return after - before


def check_goes_on(env, twin):
    """A copy of an environment does what the environment does, past the block of noise, so its generators too."""
    for k in range(60):
        one, other = env.step([0.1 * np.sin(k)]), twin.step([0.1 * np.sin(k)])
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:] == other[1:]


def check_plain_python_agrees(code, folder):
    """A program that saves numbers to its argument saves the same ones without numba, and says whether it is there."""
    found = []
    for jit in ("0", "1"):
        out = folder / f"run{jit}.npy"
        environment = {**os.environ, "AUV_GYM_JIT": jit, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(
            [sys.executable, "-c", code, str(out)], env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        assert done.stdout.strip() == str(jit == "1")
        found.append(np.load(out))
    # the cruise is sought to 1e-10 by each on its own; rounding of float32 observations is 1e-7
    np.testing.assert_allclose(found[0], found[1], rtol=1e-6, atol=2e-7)
