"""`auv-gym train`: a policy learned in an environment, on the true vehicle or on an identified model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options import environment
from auv_gym.cli.options.console import errors, output, progress_bar, table
from auv_gym.cli.options.numbers import SEED, whole_number

if TYPE_CHECKING:
    from auv_gym.rl import Trained


@app.command()
def train(
    env: Annotated[str, typer.Option(help="The environment, such as Depth-v0; see docs/environments.md.")],
    out: Annotated[Path, typer.Option(help="Folder for policy and learning curve; a stopped training run is resumed.")],
    on: environment.On = "true",
    seed: Annotated[int, whole_number("Random seed.", *SEED)] = 0,
    steps: Annotated[int | None, whole_number("Training steps. Default: as tuned.", 1, 1_000_000_000)] = None,
    envs: Annotated[int | None, whole_number("Number of parallel environments. Default: as tuned.", 1, 4096)] = None,
    frames: Annotated[int | None, whole_number("Number of stacked observations. Default: as tuned.", 1, 1000)] = None,
    recurrent: Annotated[
        bool,
        typer.Option(
            "--recurrent", help="Give the policy a recurrent layer (LSTM); excludes pretraining by imitation."
        ),
    ] = False,
    vehicle: environment.Vehicle = None,
    effect: environment.Effects = None,
    randomise: environment.Randomise = None,
    dt: environment.Dt = None,
    duration: environment.Duration = None,
    hyperparameters: Annotated[
        Path | None, typer.Option(help="File of hyperparameters (.yml), see docs/rl.md. Default: the shipped ones.")
    ] = None,
    tensorboard: Annotated[bool, typer.Option("--tensorboard", help="Also write logs for TensorBoard.")] = False,
) -> None:
    """Train a policy with PPO from stable-baselines3, and keep the one that does best on held-out episodes.

    Exit code: 130 if the training was stopped; the same command resumes it.
    """
    options = environment.parse_environment_options(vehicle, effect, randomise, dt, duration)
    with progress_bar() as progress:
        progress(0.0, "starting")
        from auv_gym.rl import Training, hyperparameters_for, train as learn

        chosen = None if hyperparameters is None else hyperparameters_for(env, hyperparameters)
        training = Training(env, on, seed, steps, envs, frames, recurrent, options, chosen)
        for words in training.remarks:
            errors.print(words, markup=False, soft_wrap=True)
        try:
            trained = learn(training, out, progress, tensorboard=tensorboard)
        except KeyboardInterrupt:
            errors.print(f"Stopped. Finished work is in {out}; the same command resumes it.", soft_wrap=True)
            raise typer.Exit(130) from None
    _tell(trained)


def _tell(trained: Trained) -> None:
    shown = table("Learning curve, returns on held-out episodes", "steps>", "time, s>", "mean>", "lowest>", "highest>")
    for row in trained.curve:
        numbers = (row["mean_return"], row["lowest_return"], row["highest_return"])
        shown.add_row(f"{row['steps']:.0f}", f"{row['seconds']:.1f}", *(f"{value:.4g}" for value in numbers))
    output.print(shown)
    result = trained.result
    output.print(
        f"Best mean return {result['best_mean_return']:.4g}, after {result['best_steps']} steps. "
        f"{result['steps_per_s']:.0f} steps/s, {100.0 * result['share_of_time_in_env']:.0f} % of the time in the "
        f"environment.",
        soft_wrap=True,
    )
    output.print(f"Written to {trained.folder}", markup=False, soft_wrap=True)
