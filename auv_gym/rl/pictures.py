"""Pictures of an agent's episode: a film strip as PNG, or a moving GIF. Needs the extra `render`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.extra import needs
from auv_gym.rl.evaluation import Agent
from auv_gym.writing import replacing

SUFFIXES = (".png", ".gif")
_STRIP, _COLUMNS = 8, 4
_MOVING, _FRAME_MS = 120, 60
_WIDTH = 640  # approximate width of a frame, pixels


def draw_episode(
    agent: Agent, env: Any, seed: int, path: Path, progress: Callable[[float], Any] | None = None
) -> list[float]:
    """Draw one episode into a .png, 8 frames at even times, or a .gif; return the times of the frames, s.

    env: made with render_mode "rgb_array".
    """
    check_picture_name(path)
    from PIL import Image

    from auv_gym.rendering import film_strip

    if env.render_mode != "rgb_array":
        raise ValueError(f"Pictures need an environment made with render_mode='rgb_array', got {env.render_mode!r}.")
    total = _length(agent, env, seed)
    wanted = _MOVING if path.suffix.lower() == ".gif" else _STRIP
    at = set(np.linspace(0, total, min(wanted, total + 1)).round().astype(int).tolist())
    frames, times = [], []
    observation, info = env.reset(seed=seed)
    act, ended = agent.begin(env), False
    for step in range(total + 1):
        if step in at:
            frames.append(_small(env.render()))
            times.append(float(info.get("time_s", step)))
        if step == total or ended:
            break
        observation, _, terminated, truncated, info = env.step(act(observation, info))
        ended = terminated or truncated
        if progress is not None:
            progress(step / total)
    with replacing(path) as new:
        if path.suffix.lower() == ".gif":
            first, *rest = [Image.fromarray(frame) for frame in frames]
            first.save(new, format="GIF", save_all=True, append_images=rest, duration=_FRAME_MS, loop=0)
        else:
            Image.fromarray(film_strip(frames, _COLUMNS)).save(new, format="PNG")
    return times


def check_picture_name(path: Path) -> None:
    """Raise unless pictures can be drawn, and written to a file of this name."""
    with needs("Pictures of an episode need matplotlib", "render"):
        import matplotlib  # noqa: F401  # it brings Pillow, too
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f"A picture needs a name that ends in {' or '.join(SUFFIXES)}, got {path.name!r}.")
    if not path.parent.is_dir():
        raise ValueError(f"The picture {path} would lie in a folder that is not there: make {path.parent} first.")


def _length(agent: Agent, env: Any, seed: int) -> int:
    """Steps of the episode, which is driven twice, since its length is not known beforehand."""
    observation, info = env.reset(seed=seed)
    act, steps, ended = agent.begin(env), 0, False
    while not ended:
        observation, _, terminated, truncated, info = env.step(act(observation, info))
        steps, ended = steps + 1, terminated or truncated
    return steps


def _small(frame: np.ndarray) -> np.ndarray:
    """A large picture reduced to every second pixel and row, or fewer, by means over squares."""
    by = max(frame.shape[1] // _WIDTH, 1)
    height, width = (size // by * by for size in frame.shape[:2])
    squares = frame[:height, :width].reshape(height // by, by, width // by, by, 3)
    return squares.mean(axis=(1, 3)).astype(np.uint8)
