"""Training with stable-baselines3: learning curve on separate episodes, the best policy kept, resumable if stopped."""

from __future__ import annotations

import json
import os
import platform
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

from auv_gym import __version__
from auv_gym.extra import needs
from auv_gym.rl.checkpoint import LATEST, Checkpoint
from auv_gym.rl.curve import CURVE, draw_curve, write_curve
from auv_gym.rl.evaluation import SELECTION, Summary, evaluate, fresh_seeds
from auv_gym.rl.policy import Policy, read_settings
from auv_gym.rl.settings import SETTINGS, Training, described, make_env
from auv_gym.writing import replacing, write_text

POLICY = "policy.zip"
_SHOWN_EVERY = 0.2  # s between two updates of the progress bar
_PACKAGES = ("numpy", "numba", "gymnasium", "stable-baselines3", "torch")

Progress = Callable[[float, str], Any]


@dataclass(frozen=True)
class Trained:
    """The result of a training: the policy, its folder, the learning curve row by row, and a summary."""

    policy: Policy
    folder: Path
    curve: tuple[dict[str, float], ...]
    result: dict[str, Any]


def train(
    training: Training, out: str | os.PathLike, progress: Progress | None = None, *, tensorboard: bool = False
) -> Trained:
    """The policy of a training, whose files are in the folder `out`; the same call resumes one that was stopped.

    progress: called with the completed share and a text.  tensorboard: also write its logs, to `out/tensorboard`.
    Raises ValueError if the folder holds another training.  A resumed training sees other episodes than an
    uninterrupted one; its result is as good, but not identical bit for bit.

    Example:

        >>> from auv_gym.rl import Hyperparameters, Training, train
        >>> short = Hyperparameters(n_timesteps=32, n_envs=2, n_steps=16, batch_size=32)
        >>> training = Training("GliderHeading", options={"duration": 40.0}, hyperparameters=short, evaluations=1)
        >>> trained = train(training, "policy")
        >>> [row["steps"] for row in trained.curve], trained.policy.observations
        ([0, 32], 5)
    """
    with needs("Training needs stable-baselines3", "rl"):
        import stable_baselines3  # noqa: F401
    if tensorboard:
        _require_tensorboard()
    imitation = training.chosen.imitate
    if imitation is not None:
        from auv_gym.rl.imitation import teacher_of

        teacher_of(training, imitation)  # raises its errors before anything is written
    folder = _made(out)
    settings = _begun(training, folder)
    if not settings["complete"]:
        _learn(training, folder, settings, progress or (lambda share, words: None), tensorboard)
    policy = Policy.load(folder)
    return Trained(policy, folder, tuple(policy.settings["curve"]), dict(policy.settings["result"]))


def _learn(training: Training, folder: Path, settings: dict[str, Any], progress: Progress, tensorboard: bool) -> None:
    from auv_gym.rl.agents import make_agent, policy_network

    checkpoint = Checkpoint.read(folder / LATEST)
    steps = training.chosen.n_timesteps
    agent, clock = make_agent(training, folder / "tensorboard" if tensorboard else None, checkpoint.steps)
    if checkpoint.steps:
        checkpoint.put_into(agent)
    env = make_env(training.env, training.on, **training.options)
    seeds = fresh_seeds(training.seed, training.episodes, SELECTION)
    watch = _Watch(agent, steps, training.evaluations, checkpoint, clock, progress)

    def judge() -> None:
        began = perf_counter()
        policy = policy_network(agent)
        summary = evaluate(policy, env, seeds).summary
        kept, checkpoint.best_mean = summary.mean > checkpoint.best_mean, max(summary.mean, checkpoint.best_mean)
        checkpoint.curve.append(watch.row(summary))
        if kept:
            checkpoint.best_steps = agent.num_timesteps
            checkpoint.keep_best(agent, policy)
        checkpoint.seconds_evaluating += perf_counter() - began
        checkpoint.write(agent)
        write_curve(checkpoint.curve, folder / CURVE)

    watch.judge = judge
    imitation = training.chosen.imitate
    if imitation is not None:
        from auv_gym.rl.imitation import freeze_action_network, imitate

        if not checkpoint.steps:
            words = f"{imitation.controller} drives"
            imitate(agent, training, imitation, lambda share: progress(0.0, f"{words}, {share:.0%} shown"))
        watch.begun = lambda: freeze_action_network(agent, agent.num_timesteps < imitation.value_steps)
    if agent.num_timesteps < steps:
        agent.learn(steps - agent.num_timesteps, callback=watch.callback(), reset_num_timesteps=not checkpoint.steps)
        watch.tick(force=True)
    if not checkpoint.curve or checkpoint.curve[-1]["steps"] < agent.num_timesteps:
        judge()
    learning = checkpoint.seconds - checkpoint.seconds_evaluating
    settings["result"] = {
        "best_steps": checkpoint.best_steps,
        "best_mean_return": checkpoint.best_mean,
        "steps": agent.num_timesteps,
        "seconds_learning": learning,
        "seconds_evaluating": checkpoint.seconds_evaluating,
        "steps_per_s": agent.num_timesteps / learning,
        "share_of_time_in_env": checkpoint.seconds_in_env / learning,
        "times_resumed": checkpoint.resumed,
    }
    settings["curve"] = checkpoint.curve
    checkpoint.publish(folder, POLICY)
    draw_curve(checkpoint.curve, folder / "learning_curve.png", training.env)
    settings["complete"] = True
    _write(folder, settings)
    checkpoint.clear()
    progress(1.0, "done")


class _Watch:
    """The callbacks while an algorithm learns: time is kept, the bar moves, and `judge` is called when it is due."""

    def __init__(
        self, agent: Any, steps: int, evaluations: int, checkpoint: Checkpoint, clock: Any, progress: Progress
    ):
        self.agent, self.steps, self.checkpoint, self.clock, self.progress = agent, steps, checkpoint, clock, progress
        self.every = max(steps / evaluations, 1.0)
        self.judge: Callable[[], None] = lambda: None
        self.begun: Callable[[], None] = lambda: None
        self._shown = self._since = perf_counter()

    def row(self, summary: Summary) -> dict[str, float]:
        """The row of the learning curve."""
        self.tick(force=True)
        recent = [episode["r"] for episode in self.agent.ep_info_buffer or ()]
        return {
            "steps": self.agent.num_timesteps,
            "seconds": round(self.checkpoint.seconds - self.checkpoint.seconds_evaluating, 3),
            "mean_return": summary.mean,
            "iqm_return": summary.iqm,
            "lowest_return": summary.lowest,
            "highest_return": summary.highest,
            "training_return": float(sum(recent) / len(recent)) if recent else float("nan"),
        }

    def due(self) -> bool:
        """Whether the policy should be judged now, also before the first step."""
        curve, steps = self.checkpoint.curve, self.agent.num_timesteps
        return not curve or (steps < self.steps and steps // self.every > curve[-1]["steps"] // self.every)

    def tick(self, force: bool = False) -> None:
        """Keep the time; move the bar."""
        now = perf_counter()
        if not force and now - self._shown < _SHOWN_EVERY:
            return
        self.checkpoint.seconds += now - self._since
        self.checkpoint.seconds_in_env += self.clock.taken()
        self._shown = self._since = now
        words = f"{self.agent.num_timesteps} of {self.steps} steps"
        if self.checkpoint.curve:
            words += f", best mean return {self.checkpoint.best_mean:.4g}"
        self.progress(min(self.agent.num_timesteps / self.steps, 1.0), words)

    def callback(self) -> Any:
        """This as a callback of stable-baselines3."""
        from stable_baselines3.common.callbacks import BaseCallback

        watch = self

        class Callback(BaseCallback):
            def _on_rollout_start(self) -> None:  # policy of all steps so far, no rollout in progress
                watch.begun()
                if watch.due():
                    watch.judge()
                    watch.tick(force=True)

            def _on_step(self) -> bool:
                watch.tick()
                return True

        return Callback()


def _begun(training: Training, folder: Path) -> dict[str, Any]:
    """The settings of a training: those in the folder if they are the same, else new ones, which are written."""
    with TemporaryDirectory() as aside:  # files of another training in the folder are not overwritten
        wanted = json.loads(json.dumps(described(training, Path(aside))))
        if not (folder / SETTINGS).is_file():
            for kept in wanted["files"].values():
                with replacing(folder / kept["name"]) as new:
                    shutil.copyfile(Path(aside) / kept["name"], new)
            settings = {**wanted, "versions": _versions(), "complete": False}
            _write(folder, settings)
            return settings
    there = read_settings(folder)
    other = [name for name, value in wanted.items() if there.get(name) != value]
    if other:
        told = "; ".join(f"{name} {there.get(name)!r}, now {wanted[name]!r}" for name in other)
        raise ValueError(f"{folder} holds another training ({told}): give another folder, or delete this one.")
    return there


def _write(folder: Path, settings: dict[str, Any]) -> None:
    write_text(folder / SETTINGS, json.dumps(settings, indent=1) + "\n")


def _made(out: str | os.PathLike) -> Path:
    folder = Path(out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"Cannot make the folder {folder}: {error.strerror or error}.") from None
    if not (folder / SETTINGS).is_file() and any(
        path.stem not in ("trained_on", "vehicle") and not path.name.startswith(".") for path in folder.iterdir()
    ):
        raise ValueError(f"{folder} holds other files and no {SETTINGS}: give a new or an empty folder.")
    return folder


def _versions() -> dict[str, str]:
    found = {"auv-gym": __version__, "python": platform.python_version()}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "none"
    return found


def _require_tensorboard() -> None:
    try:
        import tensorboard  # noqa: F401  # ty: ignore[import-not-found]
    except ImportError as error:
        raise ImportError(f"Logs for TensorBoard need its package ({error}): pip install tensorboard.") from error
