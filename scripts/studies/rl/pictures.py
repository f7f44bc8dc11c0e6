"""Figures of the study: intervals by row, learning curves, and one episode of each policy on the true vehicle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from auv_gym.channels import channel, wrap
from auv_gym.rl import Policy, fresh_seeds
from auv_gym.rl.evaluation import Agent
from controllers.piloting import pilot_for
from identification.pages.drawing import (
    AFTER,
    BEFORE,
    COMMAND,
    INK,
    QUIET,
    grid,
    new_figure,
    quantity_label,
    shown_values,
)
from scripts.studies.harness import Found
from scripts.studies.rl.scenarios import (
    ARMAX,
    BELIEVED,
    CONTROLLERS,
    DIAGNOSED,
    GREY_BOX,
    HULL,
    RANDOMISED,
    RECURRENT,
    SCENARIOS,
    STACKED,
    TRUE,
    WORDS,
    Scenario,
    policy_folder,
    true_env,
)
from scripts.studies.rl.tables import Results, by_scenario, lines_of, scores_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOKS = {  # Okabe and Ito's palette
    TRUE: INK,
    BELIEVED: BEFORE,
    DIAGNOSED: AFTER,
    ARMAX: "#009e73",
    GREY_BOX: "#cc79a7",
    HULL: "#b8860b",
    RANDOMISED: "#56b4e9",
    STACKED: "#0072b2",
    RECURRENT: "#6a3d9a",
}
LINES = {DIAGNOSED: "--", ARMAX: ":"}  # these overlap with others
EPISODE = 0  # index of the drawn one among the fresh episodes
_COLUMNS = 3


def pictures(found: Found) -> dict[str, Callable[[], Figure]]:
    """All figures, by file name."""
    results, out = by_scenario(found), found.folder
    assert out is not None  # the study always has a folder
    drawn: dict[str, Callable[[], Figure]] = {"rl_intervals.png": lambda: intervals_figure(results)}
    if any("curve" in result for rows in results.values() for of in rows.values() for result in of):
        drawn["rl_curves.png"] = lambda: curves_figure(results)
    for name in results:
        drawn[f"rl_episodes_{name}.png"] = lambda name=name: episodes_figure(
            SCENARIOS[name], episodes(results, name, out, found.options["episode_seed"])
        )
    return drawn


def intervals_figure(found: Results) -> Figure:
    """The interquartile mean of each row's cost with its interval, and the runs as ticks."""
    most = max(len(rows) for rows in found.values())
    figure = new_figure(0.34 * most + 1.3)
    panels = grid(figure, len(found), len(found))
    for axes, name in zip(panels, found, strict=True):
        lines = lines_of(found, name)
        for at, line in enumerate(lines):
            colour = LOOKS.get(line.row, QUIET)
            runs = -scores_of(found[name][line.row])
            axes.plot(runs, np.full(runs.size, at), "|", color=colour, markersize=9, alpha=0.7)
            axes.plot([-line.score.high, -line.score.low], [at, at], color=colour, linewidth=5, alpha=0.35)
            axes.plot(-line.score.value, at, "o", color=colour, markersize=5)
        axes.set_yticks(range(len(lines)), [WORDS[line.row] for line in lines])
        axes.invert_yaxis()
        axes.set_title(_two_lines(SCENARIOS[name].title), loc="left")
        axes.set_xscale("log")
        _plain_ticks(axes.xaxis)
        axes.set_xlabel("cost on the true vehicle (minus the return)")
    return figure


def curves_figure(found: Results) -> Figure:
    """Learning curves by row, mean over the seeds; each in its own training environment."""
    figure = new_figure(3.6)
    panels = grid(figure, len(found), len(found))
    for axes, name in zip(panels, found, strict=True):
        for row, results in found[name].items():
            curves = [result["curve"] for result in results if "curve" in result]
            if not curves:
                continue
            steps = 1e-3 * np.array([point["steps"] for point in curves[0]])
            costs = -np.array([[point["mean_return"] for point in curve] for curve in curves])
            style = {"linewidth": 3.0, "alpha": 0.5} if row == TRUE else {"linewidth": 1.4}
            axes.plot(steps, costs.mean(axis=0), color=LOOKS[row], label=WORDS[row], linestyle=LINES.get(row), **style)
            if row == TRUE:
                axes.fill_between(steps, costs.min(axis=0), costs.max(axis=0), color=INK, alpha=0.12, linewidth=0)
        axes.set_yscale("log")
        _plain_ticks(axes.yaxis)
        axes.set_xlabel("steps, thousands")
        axes.set_title(_two_lines(SCENARIOS[name].title), loc="left")
    panels[0].set_ylabel("cost of an episode where it is trained")
    panels[-1].legend(fontsize=7.5, loc="upper right")
    return figure


def episodes(found: Results, name: str, out: Path, episode_seed: int) -> dict[str, dict[str, np.ndarray]]:
    """By row, one fresh episode of its first run on the true vehicle, see `episode_of`."""
    scenario, shown = SCENARIOS[name], {}
    env = true_env(scenario)
    for row, (first, *_) in found[name].items():
        learned = row not in CONTROLLERS
        agent = Policy.load(policy_folder(name, row, first["seed"], out)) if learned else pilot_for(env, row)
        shown[row] = episode_of(agent, env, fresh_seeds(episode_seed, len(first["returns"]))[EPISODE], scenario)
    return shown


def episode_of(agent: Agent, env: gymnasium.Env, seed: int, scenario: Scenario) -> dict[str, np.ndarray]:
    """An episode as columns: time_s; state, target and command in readable units of the scenario's channels; reward."""
    followed, moved = channel(scenario.channel), scenario.command
    observation, info = env.reset(seed=seed)
    act, rows, ended = agent.begin(env), [], False
    while not ended:
        target = info["target"][followed.name]  # the target for the next action
        observation, reward, terminated, truncated, info = env.step(act(observation, info))
        state = dict(info["state"]).get(followed.name, dict(info["reading"])[followed.name])
        if followed.angle:
            target = state + wrap(target - state)
        rows.append((info["time_s"], state, target, dict(info["command"])[moved], float(reward)))
        ended = terminated or truncated
    time, state, target, command, reward = np.array(rows).T
    around = 2.0 * np.pi * np.round(state[0] / (2.0 * np.pi)) if followed.angle else 0.0
    shown = {
        "state": shown_values(followed.name, state - around),
        "target": shown_values(followed.name, target - around),
    }
    return {"time_s": time, **shown, "command": shown_values(moved, command), "reward": reward}


def episodes_figure(scenario: Scenario, shown: dict[str, dict[str, np.ndarray]]) -> Figure:
    """The controlled quantity of each policy and its target, on the true vehicle, above a command."""
    rows = (len(shown) + _COLUMNS - 1) // _COLUMNS
    figure = new_figure(2.5 * rows + 0.4)
    panels: Any = figure.subplots(2 * rows, _COLUMNS, squeeze=False, sharex=True, height_ratios=[2.4, 1.0] * rows)
    for axes in panels.ravel():
        axes.set_axis_off()
    limits = _limits([values for of in shown.values() for values in (of["state"], of["target"])])
    stop = max(np.abs(of["command"]).max() for of in shown.values())
    for number, (row, run) in enumerate(shown.items()):
        at, column = 2 * (number // _COLUMNS), number % _COLUMNS
        above, below = panels[at, column], panels[at + 1, column]
        above.set_axis_on()
        below.set_axis_on()
        above.plot(run["time_s"], run["target"], color=COMMAND, linestyle="--", linewidth=1.0)
        above.plot(run["time_s"], run["state"], color=LOOKS.get(row, QUIET), linewidth=1.3)
        above.set_ylim(*limits)
        above.set_title(f"{WORDS[row]}: {run['reward'].sum():.1f}", loc="left")
        below.plot(run["time_s"], run["command"], color=LOOKS.get(row, QUIET), linewidth=0.8)
        below.set_ylim(-1.05 * stop, 1.05 * stop)
        if column == 0:
            above.set_ylabel(quantity_label(scenario.channel))
            below.set_ylabel(quantity_label(scenario.command))
        if number + _COLUMNS >= len(shown):
            below.set_xlabel("time, s")
            below.tick_params(labelbottom=True)
    figure.suptitle(f"{scenario.title}: one episode, with its return; dashed: the target", fontsize=9.5)
    return figure


def _plain_ticks(axis: Any) -> None:
    """Ticks of a logarithmic axis as plain numbers."""
    from matplotlib.ticker import LogLocator, NullLocator

    axis.set_major_locator(LogLocator(subs=(1.0, 1.5, 2.0, 3.0, 5.0, 7.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter("{x:g}")


def _two_lines(title: str) -> str:
    env, vehicle, effect = title.split(", ", 2)
    return f"{env}, {vehicle}\n{effect}"


def _limits(values: Sequence[np.ndarray]) -> tuple[float, float]:
    low, high = min(v.min() for v in values), max(v.max() for v in values)
    edge = 0.1 * max(high - low, 1e-9)
    return float(low - edge), float(high + edge)
