"""The state of a training in files for resuming it; if it is killed at any moment, the last complete state remains."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.writing import replacing, write_text

if TYPE_CHECKING:
    from auv_gym.rl.policy import Policy

LATEST = "latest"
_STATE = "state.json"


@dataclass
class Checkpoint:
    """The state of a training; `state.json` is written last, and names the files that belong to it.

    seconds: in total, including in_env and evaluating.  curve: rows of the learning curve.  resumed: number of
    resumptions.
    """

    folder: Path
    steps: int = 0
    updates: int = 0
    seconds: float = 0.0
    seconds_in_env: float = 0.0
    seconds_evaluating: float = 0.0
    best_mean: float = -np.inf
    best_steps: int = 0
    curve: list[dict[str, float]] = field(default_factory=list)
    resumed: int = 0

    @classmethod
    def read(cls, folder: Path) -> Checkpoint:
        """The checkpoint in a folder, or that of a training that has not begun."""
        path = folder / _STATE
        if not path.is_file():
            return cls(folder)
        try:
            state = json.loads(path.read_text(encoding="utf-8"))
            found = cls(folder, **state)
        except (OSError, TypeError, ValueError) as error:
            raise ValueError(
                f"{path} is damaged ({error}): delete the folder {folder.parent}, and train again."
            ) from None
        found.resumed += 1
        return found

    def write(self, agent: Any) -> None:
        """Write the agent and its normalisation, and only then the state that names them."""
        self.folder.mkdir(exist_ok=True)
        self.steps, self.updates = agent.num_timesteps, agent._n_updates
        agent.save(self._agent)
        arrays = _normalizer_arrays(agent)
        if arrays:
            with self._arrays.open("wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
        state = {name: value for name, value in asdict(self).items() if name != "folder"}
        write_text(self.folder / _STATE, json.dumps(state))
        keep = {_STATE, self._agent.name, self._arrays.name, self._best.name}
        for path in self.folder.iterdir():
            if path.name not in keep:
                shutil.rmtree(path) if path.is_dir() else path.unlink()

    def put_into(self, agent: Any) -> None:
        """Restore the agent from its files; no code in the files is run."""
        from stable_baselines3.common.save_util import load_from_zip_file

        _, parameters, _ = load_from_zip_file(self._agent, device=agent.device, load_data=False)
        agent.set_parameters(parameters, device=agent.device)
        agent.num_timesteps, agent._n_updates = self.steps, self.updates
        if self._arrays.is_file():
            with np.load(self._arrays, allow_pickle=False) as arrays:
                _set_normalizer(agent, arrays)

    def keep_best(self, agent: Any, policy: Policy) -> None:
        """Keep the policy as the best one; it takes effect once the state is written."""
        self._best.mkdir(parents=True, exist_ok=True)
        agent.save(self._best / "policy.zip")
        policy.save(self._best)

    def publish(self, folder: Path, name: str) -> None:
        """Copy the best policy into the folder of the training."""
        for path in self._best.iterdir():
            with replacing(folder / (name if path.suffix == ".zip" else path.name)) as new:
                shutil.copyfile(path, new)

    def clear(self) -> None:
        """Delete the files that only a stopped training needs."""
        shutil.rmtree(self.folder, ignore_errors=True)

    @property
    def _agent(self) -> Path:
        return self.folder / f"agent-{self.steps}.zip"

    @property
    def _arrays(self) -> Path:
        return self.folder / f"arrays-{self.steps}.npz"

    @property
    def _best(self) -> Path:
        return self.folder / f"best-{self.best_steps}"


def _normalizer_arrays(agent: Any) -> dict[str, np.ndarray]:
    normalizer = agent.get_vec_normalize_env()
    if normalizer is None:
        return {}
    found = {}
    for name, moments in _moments(normalizer):
        for part in ("mean", "var", "count"):
            found[f"{name}_{part}"] = np.asarray(getattr(moments, part))
    return found


def _moments(normalizer: Any) -> list[tuple[str, Any]]:
    """Running moments by name; those of the observations only if these are normalised."""
    return [(name, getattr(normalizer, name)) for name in ("obs_rms", "ret_rms") if hasattr(normalizer, name)]


def _set_normalizer(agent: Any, arrays: Any) -> None:
    normalizer = agent.get_vec_normalize_env()
    if normalizer is not None:
        for name, moments in _moments(normalizer):
            for part in ("mean", "var"):
                setattr(moments, part, arrays[f"{name}_{part}"].copy())
            moments.count = float(arrays[f"{name}_count"])
