"""The loss of a policy trained on a model instead of the true vehicle, and how much of it a diagnosis recovers.

    python -m scripts.studies.rl --out rl --jobs 2                               about an hour
    python -m scripts.studies.rl --out tiny --steps 4096 --seeds 1 --episodes 3
    python -m scripts.studies.rl --out rl --case 'glider, *'

In each scenario the true vehicle has an effect that its modeller does not know of. Policies are trained on the true
vehicle, on models identified from its log, on the believed vehicle, on the vehicle that `diagnose` derives from the log
and the believed vehicle, and with domain randomisation about the believed vehicle. Each is evaluated on the true
vehicle, in the same episodes. The folder also keeps logs, models and policies.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from time import perf_counter
from typing import Any

from auv_gym.model import Model
from auv_gym.rl import Training, evaluate, fresh_seeds, train
from auv_gym.rl.evaluation import Agent
from auv_gym.rl.hyperparameters import hyperparameters_for
from auv_gym.rl.settings import TRUE as ITSELF
from controllers.piloting import pilot_for
from scripts.studies.harness import Option, Study
from scripts.studies.rl.models import model_of
from scripts.studies.rl.pictures import pictures
from scripts.studies.rl.scenarios import (
    BELIEVED,
    CONTROLLERS,
    PPO,
    REMEMBERING,
    SCENARIOS,
    TRUE,
    Scenario,
    case_of,
    policy_folder,
    split_case,
    true_env,
)
from scripts.studies.rl.tables import sheets

CHOOSING = 16  # episodes in the training environment by which the best policy is chosen
EVALUATIONS = 10  # of the policy during a training


def attempt(case: str, seed: int, steps: int, episodes: int, episode_seed: int, out: Path) -> dict[str, Any]:
    """Returns of a row of a scenario on the true vehicle, and data of its training; steps: 0 for the scenario's."""
    began = perf_counter()
    name, row = split_case(case)
    env, how = true_env(SCENARIOS[name]), {}
    if row in CONTROLLERS:
        agent: Agent = pilot_for(env, row)
    else:
        trained = train(training_of(name, row, seed, out, steps), policy_folder(name, row, seed, out))
        agent, how = trained.policy, {"training": trained.result, "curve": list(trained.curve)}
    found = evaluate(agent, env, fresh_seeds(episode_seed, episodes))
    done = {"returns": found.returns.tolist(), "steps": found.steps.tolist(), "cut": found.cut}
    return {"seed": seed, **done, "seconds": perf_counter() - began, **how}


def training_of(name: str, row: str, seed: int, out: Path, steps: int) -> Training:
    """The training of a row; makes its model from the log of this seed if needed."""
    scenario = SCENARIOS[name]
    options: dict[str, Any] = scenario.settings
    on: str | Model = ITSELF
    if row == TRUE:
        on, options = scenario.driven_by(scenario.truth)
    elif row in REMEMBERING:
        options["randomise"] = {path: list(limits) for path, limits in scenario.ranges.items()}
    elif row != BELIEVED:
        on, options = scenario.driven_by(model_of(scenario, row, seed, out / name / "models"))
    return Training(
        scenario.env,
        on=on,
        seed=seed,
        options=options,
        hyperparameters={**learning_of(scenario), "n_timesteps": steps or scenario.steps, "gamma": scenario.gamma},
        evaluations=EVALUATIONS,
        episodes=CHOOSING,
        **REMEMBERING.get(row, {}),
    )


def learning_of(scenario: Scenario) -> Mapping[str, Any]:
    """The hyperparameters of a scenario, without steps and discount."""
    return hyperparameters_for(scenario.env).model_dump(exclude_unset=True) if scenario.shipped else PPO


def seeds_of(case: str, seeds: Sequence[int]) -> Sequence[int]:
    """The seeds of a case; a controller learns nothing, so it has one run."""
    return seeds[:1] if split_case(case)[1] in CONTROLLERS else seeds


def _facts(scenario: Scenario) -> dict[str, Any]:
    return {key: value for key, value in asdict(scenario).items() if key != "title"}


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(case_of(name, row) for name, scenario in SCENARIOS.items() for row in scenario.all_rows),
    sheets,
    seeds=5,
    seeds_of=seeds_of,
    options={
        "steps": Option(0, "of each training; 0: the scenario's", least=0),
        "episodes": Option(50, "to judge by", least=1),
        "episode_seed": Option(0, "of these episodes"),
    },
    pictures=pictures,
    facts={"ppo": dict(PPO), "scenarios": {name: _facts(scenario) for name, scenario in SCENARIOS.items()}},
    keeps=True,
)
