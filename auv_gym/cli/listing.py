"""`auv-gym list`: vehicles, kinds of part, effects, methods and channels."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from auv_gym.cli.application import app
from auv_gym.cli.options.choices import choice_argument
from auv_gym.cli.options.console import output, table

if TYPE_CHECKING:
    from auv_gym.vehicles.body.kinds import PartKind


class Listing(StrEnum):
    """What `auv-gym list` can list."""

    vehicles = "vehicles"
    parts = "parts"
    effects = "effects"
    methods = "methods"
    channels = "channels"


@app.command(name="list")
def list_things(
    what: Annotated[Listing | None, choice_argument(Listing, "Default: everything.")] = None,
    vehicle: Annotated[
        str | None,
        typer.Argument(
            metavar="VEHICLE", help="With effects: the preset or vehicle file (.toml) whose effects to list."
        ),
    ] = None,
) -> None:
    """List vehicles, part kinds, effects, identification methods, and channels with their units."""
    if vehicle is not None and what is not Listing.effects:
        wanted = what.value if what else "everything"
        raise typer.BadParameter(
            f"only effects are listed for a vehicle, got {wanted!r}: auv-gym list effects {vehicle}"
        )
    tables = {
        Listing.vehicles: _vehicles,
        Listing.parts: _parts,
        Listing.effects: _effects if vehicle is None else lambda: _effects_of(vehicle),
        Listing.methods: _methods,
        Listing.channels: _channels,
    }
    for name, make in tables.items():
        if what in (None, name):
            output.print(make())


def _vehicles() -> Table:
    from auv_gym.presets import list_preset_headings

    shown = table("Vehicles", "name!", "family", "dt, s>", "what")
    for name, heading in list_preset_headings().items():
        shown.add_row(name, heading.family, f"{heading.dt:g}", heading.title)
    return shown


def _parts() -> Table:
    from auv_gym.vehicles.body.kinds import part_kinds

    shown = table("Kinds of part of a vehicle in six degrees of freedom", "kind!", "what", "forms", "inputs")
    for name, kind in part_kinds().items():
        forms = kind.variants or {"": kind}
        chosen = f"{kind.choice} = {', '.join(kind.variants)}" if kind.variants else ""
        inputs = [" and ".join(c.channel or f"NAME_{c.suffix}" for c in form.commands) for form in forms.values()]
        shown.add_row(name, kind.title, chosen, ", ".join(dict.fromkeys(filter(None, inputs))))
    return shown


def _effects() -> Table:
    from auv_gym.vehicles import effects_by_kind
    from auv_gym.vehicles.body.kinds import part_kinds

    shown = table("Effects, by kind of vehicle and of part", "path", "neutral>", "bounds>", "probe>")
    for kind, effects in effects_by_kind().items():
        shown.add_row(f"[bold]{kind}[/]")
        _add(shown, effects, "effects.")
        shown.add_section()
    for name, kind in part_kinds().items():
        for effects, forms in _by_effects(kind).items():
            shown.add_row(f"[bold]part of kind {name}{forms}[/]")
            _add(shown, effects(), "effects.NAME.")
        shown.add_section()
    return shown


def _by_effects(kind: PartKind) -> dict[type, str]:
    """The groups of effects of a kind's forms, each with the forms that have it where they differ."""
    forms: dict[type, list[str]] = {}
    for choice, form in (kind.variants or {"": kind}).items():
        forms.setdefault(form.effects, []).append(choice)
    several = len(forms) > 1
    return {effects: f", {kind.choice} = {', '.join(names)}" if several else "" for effects, names in forms.items()}


def _effects_of(vehicle: str) -> Table:
    from auv_gym.plant import load_vehicle

    plant = load_vehicle(vehicle)
    shown = table(f"Effects of {plant.name}", "path", "neutral>", "bounds>", "probe>")
    _add(shown, plant.effects, "effects.")
    return shown


def _add(shown: Table, tree: Any, prefix: str) -> None:
    """The rows of a tree of effects."""
    from auv_gym.param import list_paths, spec_at

    for path in list_paths(tree):
        if not path.startswith("discovered."):
            spec = spec_at(tree, path)
            low, high = spec.bounds
            numbers = (f"{spec.neutral:g}", f"{low:.3g} to {high:.3g}", f"{spec.probe:g}")
            unit = {"1": "", "channel's": ", in the channel's unit"}.get(spec.unit, f", {spec.unit}")
            title = spec.title.replace("{}", "NAME")
            shown.add_row(f"{prefix}{path}\n  [dim]{title}{unit}[/]", *numbers)
    discovered = [path.split(".") for path in list_paths(tree) if path.startswith("discovered.")]
    if discovered:  # hundreds of them: every axis has the same terms
        axes, terms = (", ".join(dict.fromkeys(names[i] for names in discovered)) for i in (1, 2))
        text = f"terms found in data; axes: {axes}; terms: {terms}"
        shown.add_row(f"effects.discovered.AXIS.TERM\n  [dim]{text}[/]", "0", "any", "0")


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
