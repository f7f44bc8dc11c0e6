"""`auv-gym list`: vehicles, effects, methods and channels."""

from __future__ import annotations

from enum import StrEnum
from typing import Annotated

import typer
from rich.table import Table

from auv_gym.cli.application import app
from auv_gym.cli.console import output, table


class Listing(StrEnum):
    """What `auv-gym list` can list."""

    vehicles = "vehicles"
    effects = "effects"
    methods = "methods"
    channels = "channels"


@app.command(name="list")
def list_things(
    what: Annotated[Listing | None, typer.Argument(help="Default: all of them.")] = None,
) -> None:
    """List vehicles, their effects, methods of identification, and channels with their units."""
    tables = {
        Listing.vehicles: _vehicles,
        Listing.effects: _effects,
        Listing.methods: _methods,
        Listing.channels: _channels,
    }
    for name, make in tables.items():
        if what in (None, name):
            output.print(make())


def _vehicles() -> Table:
    from auv_gym.presets import list_headings

    shown = table("Vehicles", "name!", "family", "dt, s>", "what")
    for name, heading in list_headings().items():
        shown.add_row(name, heading.family, f"{heading.dt:g}", heading.title)
    return shown


def _effects() -> Table:
    from auv_gym.effects import EFFECTS
    from auv_gym.param import list_paths, spec_at

    shown = table("Effects, by kind of vehicle", "path", "neutral>", "bounds>", "probe>")
    for kind, effects in EFFECTS.items():
        shown.add_row(f"[bold]{kind}[/]")
        tree = effects()
        for path in list_paths(tree):
            if not path.startswith("discovered."):
                spec = spec_at(tree, path)
                low, high = spec.bounds
                numbers = (f"{spec.neutral:g}", f"{low:.3g} to {high:.3g}", f"{spec.probe:g}")
                unit = "" if spec.unit == "1" else f", {spec.unit}"
                shown.add_row(f"effects.{path}\n  [dim]{spec.title}{unit}[/]", *numbers)
        discovered = [path.split(".") for path in list_paths(tree) if path.startswith("discovered.")]
        if discovered:  # hundreds of them: every axis has the same terms
            axes, terms = (", ".join(dict.fromkeys(names[i] for names in discovered)) for i in (1, 2))
            text = f"terms found in data; axes: {axes}; terms: {terms}"
            shown.add_row(f"effects.discovered.AXIS.TERM\n  [dim]{text}[/]", "0", "any", "0")
        shown.add_section()
    return shown


def _methods() -> Table:
    from identification.estimator import list_methods

    shown = table("Methods of `auv-gym identify`", "name!", "what", "settings (* needed)")
    for method in list_methods().values():
        if method.problem:
            shown.add_row(method.name, method.title, f"[red]{method.problem}[/]")
            continue
        shown.add_row(method.name, method.title, method.setting_names)
    return shown


def _channels() -> Table:
    from auv_gym.channels import CHANNELS

    shown = table("Channels", "name!", "unit", "kind", "what")
    for channel in CHANNELS.values():
        shown.add_row(channel.name, channel.unit, channel.kind, channel.label)
    return shown
