"""`auv-gym evaluate`: evaluate a trained policy on fresh episodes, and controllers on the same episodes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from auv_gym.cli.application import app
from auv_gym.cli.options import environment
from auv_gym.cli.options.console import output, progress_bar, table
from auv_gym.cli.options.numbers import SEED, whole_number

if TYPE_CHECKING:
    from auv_gym.rl import Evaluation


@app.command()
def evaluate(
    folder: Annotated[Path, typer.Argument(metavar="FOLDER", help="The folder that `auv-gym train` wrote.")],
    env: Annotated[str | None, typer.Option(help="Environment to evaluate in. Default: that of the training.")] = None,
    on: environment.On = "true",
    episodes: Annotated[int, whole_number("Number of episodes; all agents get the same ones.", 2, 1_000_000)] = 50,
    seed: Annotated[int, whole_number("Random seed of the episodes, which training has never seen.", *SEED)] = 0,
    against: Annotated[
        str | None, typer.Option(metavar="pid,s-plane,gpc", help="Controllers to compare with, separated by commas.")
    ] = None,
    vehicle: environment.Vehicle = None,
    effect: environment.Effects = None,
    randomise: environment.Randomise = None,
    dt: environment.Dt = None,
    duration: environment.Duration = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the policy's first episode as a strip (.png) or an animation (.gif).")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, with the return of every episode.")] = False,
) -> None:
    """Evaluate a trained policy on fresh episodes: mean and interquartile mean of the returns, with 95 % intervals.

    Environment options that are not given are taken from the training.
    """
    options = environment.parse_environment_options(vehicle, effect, randomise, dt, duration)
    with progress_bar() as progress:
        progress(0.0, "starting")
        from auv_gym.rl import Policy, evaluate as judged, fresh_seeds
        from controllers.piloting import pilot_for

        if picture is not None:
            from auv_gym.rl.pictures import check_picture_name, draw_episode

            check_picture_name(picture)
        policy = Policy.load(folder)
        made = policy.env(on, env=env, **options)
        names = [name.strip() for name in (against or "").split(",") if name.strip()]
        agents: dict[str, Any] = {"policy": policy} | {name: pilot_for(made, name) for name in names}
        seeds = fresh_seeds(seed, episodes)
        found: dict[str, Evaluation] = {}
        for number, (name, agent) in enumerate(agents.items()):
            share = 1.0 / (len(agents) + (picture is not None))
            tell = _part(progress, number * share, share, name)
            found[name] = judged(agent, made, seeds, tell)
        if picture is not None:
            shown = policy.env(on, env=env, render_mode="rgb_array", **options)
            draw_episode(policy, shown, seeds[0], picture, _part(progress, 1.0 - share, share, "drawing"))
            shown.close()
        progress(1.0, "done")
    if as_json:
        told = {name: _as_dict(one, found["policy"]) for name, one in found.items()}
        told = {"env": env or policy.settings["env"], "on": on, "seed": seed, "agents": told}
        typer.echo(json.dumps(told, indent=1))
        return
    output.print(_shown(found, f"PPO in {made.spec.id}, {episodes} episodes"))
    output.print(
        "Returns with 95 % intervals by the bootstrap over episodes; IQM: interquartile mean, of the middle half; "
        "cut: episodes that ended early.",
        soft_wrap=True,
    )
    if picture is not None:
        output.print(f"Written to {picture}", markup=False, soft_wrap=True)


def _part(progress: Any, first: float, share: float, words: str) -> Any:
    return lambda done: progress(first + share * done, words)


def _shown(found: dict[str, Evaluation], title: str) -> Table:
    from auv_gym.rl import Summary

    columns = ("agent!", "mean>", "IQM>", "cut>", "policy ahead by>")
    shown = table(title, *columns)
    for name, one in found.items():
        said = one.summary
        ahead = ""
        if name != "policy":
            difference = Summary.of(found["policy"].returns - one.returns)
            ahead = _with_interval(difference.mean, difference.mean_interval, "+")
        shown.add_row(
            name,
            _with_interval(said.mean, said.mean_interval),
            f"{said.iqm:.4g}",
            f"{one.cut}",
            ahead,
        )
    return shown


def _with_interval(value: float, interval: tuple[float, float], sign: str = "") -> str:
    low, high = interval
    return rf"{value:{sign}.4g} \[{low:.3g}, {high:.3g}]"


def _as_dict(one: Evaluation, policy: Evaluation) -> dict[str, Any]:
    from dataclasses import asdict

    from auv_gym.rl import Summary

    told = {**asdict(one.summary), "cut_short": one.cut, "returns": one.returns.tolist(), "seeds": list(one.seeds)}
    if one is not policy:
        difference = Summary.of(policy.returns - one.returns)
        told["policy_minus_this"] = {"mean": difference.mean, "mean_interval": difference.mean_interval}
    return told
