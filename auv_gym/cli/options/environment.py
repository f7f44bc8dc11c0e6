"""Options that say which environment a command means."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import typer

from auv_gym.cli.options.numbers import LENGTH, TIME_STEP, number

On = Annotated[
    str,
    typer.Option(
        metavar="true|FILE",
        help="Dynamics of the environment: true for its own vehicle, or a model (.npz) or vehicle file (.toml).",
    ),
]
Vehicle = Annotated[
    str | None,
    typer.Option(help="A preset (see `auv-gym list vehicles`) or a vehicle file. Default: the environment's."),
]
Effects = Annotated[
    list[str] | None,
    typer.Option(metavar="PATH=VALUE", help="An effect, such as effects.rudder.offset=0.05; may be repeated."),
]
Randomise = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=LOW:HIGH",
        help="A parameter drawn at random in each episode, such as effects.current.north=-0.2:0.2; may be repeated.",
    ),
]
Dt = Annotated[float | None, number("Sample time, s. Default: the vehicle's.", *TIME_STEP)]
Duration = Annotated[float | None, number("Length of an episode, s. Default: the environment's.", *LENGTH)]


def parse_environment_options(
    vehicle: str | None,
    effect: Sequence[str] | None,
    randomise: Sequence[str] | None,
    dt: float | None,
    duration: float | None,
) -> dict[str, Any]:
    """The options of an environment, as far as they were given; raises on what is no PATH=VALUE."""
    options: dict[str, Any] = {"vehicle": vehicle, "dt": dt, "duration": duration}
    if effect:
        options["effects"] = dict(effect_of(text) for text in effect)
    if randomise:
        options["randomise"] = dict(_range(text) for text in randomise)
    return {name: value for name, value in options.items() if value is not None}


def effect_of(text: str) -> tuple[str, float]:
    """The path and the value of an effect, from PATH=VALUE."""
    path, separator, value = text.partition("=")
    try:
        return path.strip(), float(value)
    except ValueError:
        got = "no '='" if not separator else f"the value {value!r}"
        raise ValueError(
            f"--effect needs PATH=VALUE, such as effects.rudder.offset=0.05, got {got} in {text!r}."
        ) from None


def _range(text: str) -> tuple[str, tuple[float, float]]:
    path, _, value = text.partition("=")
    low, _, high = value.partition(":")
    try:
        return path.strip(), (float(low), float(high))
    except ValueError:
        raise ValueError(
            f"--randomise needs PATH=LOW:HIGH, such as effects.current.north=-0.2:0.2, got {text!r}."
        ) from None
