"""One policy trained and judged on the true vehicle, or one controller; what is done stays in files."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium

from auv_gym.rl import Policy, Training, evaluate, fresh_seeds, train
from auv_gym.rl.evaluation import Agent
from auv_gym.rl.settings import TRUE as ITSELF
from auv_gym.rl.settings import make_env
from auv_gym.writing import replacing
from controllers.piloting import pilot_for
from scripts.rl.models import model_of
from scripts.rl.settings import BELIEVED, CONTROLLERS, RANDOMISED, SETTINGS, TRUE, Setting, Study

KEPT = "study.json"
CHOOSING = 16  # episodes by which the best policy of a training is chosen, where it is trained


def done(name: str, row: str, seed: int, out: Path) -> dict[str, Any] | None:
    """The result of a row and seed, if it is there."""
    path = _result(name, row, seed, out)
    return json.loads(path.read_text(encoding="utf-8")) if path.is_file() else None


def work(name: str, row: str, seed: int, out: Path, study: Study) -> dict[str, Any]:
    """The result of a row and seed: returns on the true vehicle, and how the training went; done if it is not yet."""
    found = done(name, row, seed, out)
    if found is not None:
        return found
    _one_thread()
    setting, began = SETTINGS[name], perf_counter()
    if row not in setting.all_rows:
        raise ValueError(f"{name} has no row {row!r}; it has {', '.join(setting.all_rows)}.")
    env = true_env(setting)
    how: dict[str, Any] = {}
    if row in CONTROLLERS:
        agent: Agent = pilot_for(env, row)
    else:
        trained = train(training_of(name, row, seed, out, study), policy_folder(name, row, seed, out))
        agent, how = trained.policy, {"training": trained.result, "curve": list(trained.curve)}
    found = evaluate(agent, env, fresh_seeds(study.seed, study.episodes))
    result = {
        "setting": name,
        "row": row,
        "seed": seed,
        "returns": found.returns.tolist(),
        "steps": found.steps.tolist(),
        "cut": found.cut,
        "seconds": perf_counter() - began,
        **how,
    }
    path = _result(name, row, seed, out)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as new:
        new.write_text(json.dumps(result) + "\n", encoding="utf-8")
    return result


def agent_of(name: str, row: str, seed: int, out: Path, env: gymnasium.Env) -> Agent:
    """The policy or controller of a row that is done."""
    return pilot_for(env, row) if row in CONTROLLERS else Policy.load(policy_folder(name, row, seed, out))


def true_env(setting: Setting) -> gymnasium.Env:
    """The environment that all rows are judged in: the true vehicle with noisy sensors.

    Scales, limits and what a controller knows are those of the believed vehicle, as an operator would have them.
    """
    return make_env(setting.env, setting.truth, vehicle=setting.vehicle, dt=setting.dt, **setting.options)


def training_of(name: str, row: str, seed: int, out: Path, study: Study) -> Training:
    """What a row is trained on; makes its model from the log of this seed where it needs one."""
    setting = SETTINGS[name]
    options: dict[str, Any] = {"vehicle": setting.vehicle, "dt": setting.dt, **setting.options}
    env, on = setting.env, ITSELF
    if row == TRUE:
        on = setting.truth
    elif row == RANDOMISED:
        options["randomise"] = {path: list(limits) for path, limits in setting.ranges.items()}
    elif row != BELIEVED:
        on = model_of(setting, row, seed, out / name / "models")
    return Training(
        env,
        on=on,
        seed=seed,
        options=options,
        hyperparameters=study.learning(setting),
        evaluations=study.evaluations,
        episodes=CHOOSING,
    )


def policy_folder(name: str, row: str, seed: int, out: Path) -> Path:
    """Where a training leaves its files."""
    return out / name / row / f"seed_{seed}"


def begin(out: Path, study: Study) -> None:
    """Say in the folder what its results depend on; raises where it holds a study with other settings."""
    out.mkdir(parents=True, exist_ok=True)
    settings = {name: {k: v for k, v in asdict(s).items() if k != "title"} for name, s in SETTINGS.items()}
    wanted = json.loads(json.dumps({"study": asdict(study), "settings": settings}))
    path = out / KEPT
    if path.is_file():
        there = json.loads(path.read_text(encoding="utf-8"))
        if there != wanted:
            raise ValueError(
                f"{out} holds results of a study with other settings (see {path.name}): give another --out, or the "
                "same --steps, --episodes and --seed."
            )
        return
    with replacing(path) as new:
        new.write_text(json.dumps(wanted, indent=1) + "\n", encoding="utf-8")


def _result(name: str, row: str, seed: int, out: Path) -> Path:
    return out / name / row / f"seed_{seed}.json"


def _one_thread() -> None:
    """This process leaves the other cores to the other jobs."""
    import numba

    numba.set_num_threads(1)
