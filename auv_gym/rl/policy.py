"""A trained policy: scaling of its observations, and its network as plain arrays; needs numpy only."""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym import __version__
from auv_gym.rl.settings import FORMAT, SETTINGS, TRUE, VERSION, make_env
from auv_gym.writing import replacing

NETWORK, SCALING = "network.npz", "scaling.npz"
_CELL = ("cell_input", "cell_hidden", "cell_bias")


def _elu(values: np.ndarray) -> np.ndarray:
    return np.where(values > 0.0, values, np.expm1(np.minimum(values, 0.0)))


_ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "tanh": np.tanh,
    "relu": lambda values: np.maximum(values, 0.0),
    "elu": _elu,
}


@dataclass(frozen=True, eq=False)
class Scaling:
    """Observations minus their mean, over their standard deviation, within `clip`, as in the training."""

    mean: np.ndarray
    variance: np.ndarray
    clip: float = 10.0
    epsilon: float = 1e-8

    def __call__(self, observation: np.ndarray) -> np.ndarray:
        scaled = (observation - self.mean) / np.sqrt(self.variance + self.epsilon)
        return np.clip(scaled, -self.clip, self.clip).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Policy:
    """The action for an observation, without noise; a multilayer perceptron in single precision.

    weights: of each layer, (outputs, inputs).  activation: between layers.  Actions beyond [-1, 1] are clipped.
    cell: of an LSTM before them, weights (4 h, inputs) and (4 h, h) and biases (4 h,), in PyTorch's order; () for none.
    frames: number of latest observations that the network sees at once, oldest first; 0 before an episode's start.
    scaling: of observations, or None.  settings: content of the training's `settings.json`.

    Example:

        >>> import numpy as np
        >>> from auv_gym.rl import Policy
        >>> policy = Policy((np.array([[-2.0, 0.5]]),), (np.zeros(1),))
        >>> policy.act(np.array([0.2, 0.4])).round(3)
        array([-0.2])
    """

    weights: tuple[np.ndarray, ...]
    biases: tuple[np.ndarray, ...]
    activation: str = "tanh"
    scaling: Scaling | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    folder: Path | None = None
    cell: tuple[np.ndarray, ...] = ()
    frames: int = 1

    def act(self, observation: np.ndarray) -> np.ndarray:
        """The action for one observation, shape (actions,), or for several, shape (n, actions); float32.

        Raises for a policy that remembers earlier observations: use `begin` for an episode.
        """
        if self.frames > 1 or self.cell:
            raise ValueError("This policy remembers earlier observations: use what begin() returns for each episode.")
        return self._answer(self._seen(observation))

    def begin(self, env: Any = None) -> Callable[..., np.ndarray]:
        """A function that returns the action for each observation of an episode, see `auv_gym.rl.evaluation.Agent`."""
        frames = np.zeros((self.frames, self.observations), np.float32)
        hidden = kept = np.zeros(self.cell[1].shape[1] if self.cell else 0, np.float32)

        def act(observation: np.ndarray, info: Any = None) -> np.ndarray:
            nonlocal hidden, kept
            frames[:-1] = frames[1:]
            frames[-1] = self._seen(observation)
            x = frames.ravel()
            if self.cell:
                hidden, kept = _lstm(self.cell, x, hidden, kept)
                x = hidden
            return self._answer(x)

        return act

    @property
    def observations(self) -> int:
        """Length of an observation."""
        return (self.cell or self.weights)[0].shape[1] // self.frames

    def _seen(self, observation: np.ndarray) -> np.ndarray:
        """The observation in the form of the network; raises if its size is wrong."""
        x = np.asarray(observation, dtype=np.float32)
        if x.shape[-1:] != (self.observations,):
            raise ValueError(
                f"The policy needs observations of {self.observations} numbers, got shape {x.shape}: it was "
                f"trained in {self.settings.get('env', 'another environment')}."
            )
        return x if self.scaling is None else self.scaling(x)

    def _answer(self, x: np.ndarray) -> np.ndarray:
        """The output of the layers for scaled observations."""
        between = _ACTIVATIONS[self.activation]
        for weight, bias in zip(self.weights[:-1], self.biases[:-1]):
            x = between(x @ weight.T + bias)
        return np.clip(x @ self.weights[-1].T + self.biases[-1], -1.0, 1.0)

    @classmethod
    def load(cls, folder: str | os.PathLike) -> Policy:
        """The policy that `train` wrote to a folder; raises with any problem in it. No code in the files is run."""
        folder = Path(folder)
        settings = read_settings(folder)
        if not settings.get("complete"):
            raise ValueError(f"The training in {folder} was stopped: give the same command again, which goes on.")
        network = _arrays(folder / NETWORK)
        scaling = _arrays(folder / SCALING) if (folder / SCALING).is_file() else None
        try:
            layers = range(int(network["layers"]))
            policy = cls(
                tuple(network[f"weight_{i}"] for i in layers),
                tuple(network[f"bias_{i}"] for i in layers),
                str(network["activation"]),
                None if scaling is None else Scaling(scaling["mean"], scaling["variance"], float(scaling["clip"])),
                settings,
                folder,
                tuple(network[name] for name in _CELL if name in network),
                int(network.get("frames", 1)),
            )
        except KeyError as error:
            raise ValueError(f"{folder} holds no whole policy ({error} is missing): train it again.") from None
        if policy.activation not in _ACTIVATIONS:
            raise ValueError(f"{folder / NETWORK} has an activation that this version does not know: update auv-gym.")
        return policy

    def save(self, folder: Path) -> None:
        """Write network and scaling into a folder, as a whole or not at all; the training writes the settings."""
        layers = {f"weight_{i}": w for i, w in enumerate(self.weights)} | {
            f"bias_{i}": b for i, b in enumerate(self.biases)
        }
        with replacing(folder / NETWORK) as new, new.open("wb") as file:
            kept = {"layers": len(self.weights), "frames": self.frames, "activation": self.activation}
            np.savez(file, allow_pickle=False, **kept, **layers, **dict(zip(_CELL, self.cell)))
        if self.scaling is not None:
            with replacing(folder / SCALING) as new, new.open("wb") as file:
                np.savez(file, mean=self.scaling.mean, variance=self.scaling.variance, clip=np.array(self.scaling.clip))

    def env(self, on: Any = TRUE, *, env: str | None = None, render_mode: str | None = None, **options: Any) -> Any:
        """The environment of its training, driven by the vehicle or by `on`.

        options: replace those of the training.  env: another environment; then only the vehicle is kept of the
        training's options.  Raises if its observations or actions differ from the policy's.
        """
        if self.folder is None:
            raise ValueError("This policy was not loaded from a folder, so its environment is not known: make it.")
        trained = dict(self.settings["options"])
        if "vehicle" in self.settings["files"]:
            trained["vehicle"] = self.folder / self.settings["files"]["vehicle"]["name"]
        if env is not None:
            trained = {name: value for name, value in trained.items() if name == "vehicle"}
        if (
            not isinstance(on, str) or on != TRUE
        ):  # with another model, effects of the vehicle do not apply, but those of sensors do
            for name in ("effects", "randomise"):
                kept = {path: v for path, v in trained.pop(name, {}).items() if path.startswith("effects.sampling.")}
                trained |= {name: kept} if kept else {}
        trained |= {name: value for name, value in options.items() if value is not None}
        made = make_env(env or self.settings["env"], on, render_mode, **trained)
        sizes = (made.observation_space.shape, made.action_space.shape)
        own = ((self.observations,), (self.weights[-1].shape[0],))
        if sizes != own:
            raise ValueError(
                f"The policy has {own[0][0]} observations and {own[1][0]} actions, and the environment {sizes[0]} and "
                f"{sizes[1]}: evaluate it in the one it was trained in, {self.settings['env']}."
            )
        return made


def _lstm(
    cell: tuple[np.ndarray, ...], x: np.ndarray, hidden: np.ndarray, kept: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The next output and memory of a recurrent layer.  Source: Hochreiter and Schmidhuber 1997; gates as PyTorch's."""
    of_input, of_hidden, bias = cell
    into, forget, new, out = np.split(of_input @ x + of_hidden @ hidden + bias, 4)
    kept = _sigmoid(forget) * kept + _sigmoid(into) * np.tanh(new)
    return _sigmoid(out) * np.tanh(kept), kept


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return 0.5 + 0.5 * np.tanh(0.5 * values)


def read_settings(folder: Path) -> dict[str, Any]:
    """The content of `settings.json` in a training's folder; raises if there is none."""
    path = folder / SETTINGS
    if not path.is_file():
        raise ValueError(f"There is no {path}: give a folder that `auv-gym train` wrote.")
    try:
        settings = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path} is damaged ({error}): train again.") from None
    if not isinstance(settings, dict) or settings.get("format") != FORMAT:
        raise ValueError(f"{path} contains no policy: give a folder that `auv-gym train` wrote.")
    if not isinstance(settings.get("version"), int) or settings["version"] > VERSION:
        raise ValueError(
            f"{path} has version {settings.get('version')!r} of its format, and this is auv-gym {__version__}, which "
            f"reads up to {VERSION}: update auv-gym."
        )
    return settings


def _arrays(path: Path) -> dict[str, np.ndarray]:
    try:
        with np.load(path, allow_pickle=False) as content:
            return {name: content[name] for name in content.files}
    except FileNotFoundError:
        raise ValueError(f"There is no {path}: train again, or copy the whole folder.") from None
    except (OSError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is damaged ({error}): train again.") from None
