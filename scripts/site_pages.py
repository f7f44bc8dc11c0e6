"""Write the sources of the documentation to one folder: docs/, and pages of parts, effects, channels and commands.

`python -m scripts.site_pages` writes build/docs, from which `make docs` builds the site.
"""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

from auv_gym.channels import CHANNELS
from auv_gym.param import list_paths, spec_at
from auv_gym.vehicles import Part, compose, effects_by_kind
from auv_gym.vehicles.body.kinds import part_kinds

_ROOT = Path(__file__).parents[1]
_OF_EFFECTS = """
Every effect is in every simulation, neutral until it is set: `effects={PATH: VALUE}` of an environment,
`--effect PATH=VALUE` of `auv-gym simulate`, `replace_at(plant, PATH, VALUE)` in Python. *Probe* is the smallest change
worth detecting; an effect without one is a setting of the others and no candidate of a diagnosis. What can happen to
the parts of a body is listed by [kind of part](parts.md). The command `auv-gym list effects` prints the same, `auv-gym
list effects VEHICLE` the effects of one vehicle.
""".strip()
_OF_PARTS = """
A vehicle in six degrees of freedom is a hull and its parts. `NAME` is the name that a vehicle file gives to the part,
`[parts.NAME]`. *Probe* is the smallest change worth detecting; an effect without one is no candidate of a diagnosis.
What the kinds are for: [A hull and its parts](../vehicles.md#a-hull-and-its-parts).
""".strip()
_OF_CHANNELS = """
Records, models, environments and reports name their signals by these, in SI and radians. The columns of a file may be
in other units, by suffix (`heading_deg`, `speed_kn`, `pressure_dbar`).
""".strip()
_FAMILIES = (
    ("glider", "Gliders", "The heading of a glider."),
    (
        "glide",
        "Gliders that fly",
        "Depth and displacement of a glider, by its polar; `effects.steering` acts where its masses steer it.",
    ),
    ("body", "Vehicles in six degrees of freedom", "Of every hull, beside the effects of its parts."),
    (
        "float",
        "Profiling floats",
        "`effects.oil` acts where the engine is an oil bladder, `effects.piston` where it is a piston.",
    ),
)
_LONG_TABLE = 20  # numbers of a curve or a table of thrust above which only the first and the last are listed


def write(folder: Path) -> None:
    """Empty the folder, copy docs/ there, and write the generated pages beside."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(_ROOT / "docs", folder)
    for path, text in made_pages().items():
        (folder / path).parent.mkdir(exist_ok=True)
        (folder / path).write_text(text, encoding="utf-8")


def made_pages() -> dict[str, str]:
    """The text of each generated page by its path."""
    return {
        "reference/parts.md": parts_page(),
        "reference/effects.md": effects_page(),
        "reference/channels.md": channels_page(),
        "reference/commands.md": commands_page(),
        "contributing.md": _beside("CONTRIBUTING.md"),
        "changelog.md": _beside("CHANGELOG.md"),
    }


def parts_page() -> str:
    """The page of every kind of part: its forms and their commands, its parameters and effects."""
    pages = [f"# Parts\n\n{_OF_PARTS}\n"]
    for name, kind in part_kinds().items():
        forms = list((kind.variants or {"": kind}).items())
        pages.append(f'## {name}\n\n`kind = "{name}"`: {kind.title}.\n')
        for choice, form in forms:
            part = Part("NAME", name, choice)
            commands = ", ".join(f"`{part.channel(i)}`" for i in range(len(form.commands))) or "none"
            pages.append(f'- `{form.choice} = "{choice}"`: command {commands}' if choice else f"Command: {commands}.")
        tables: dict[str, list[str]] = {}
        for choice, _ in forms:
            tree = compose([Part("NAME", name, choice)]).parameters()
            tables.setdefault(_parameter_table(tree), []).append("")
            tables.setdefault(_effect_table(tree, _below(tree, "effects.NAME.")), []).append(choice)
        for table, choices in tables.items():
            shared = len(choices) == len(forms)
            pages.append(f"\n{table}" if shared else f'\nWith `{kind.choice} = "{choices[0]}"`:\n\n{table}')
        pages.append("")
    return "\n".join(pages)


def _below(tree: Any, head: str) -> list[str]:
    return [path for path in list_paths(tree) if path.startswith(head)]


def _parameter_table(tree: Any) -> str:
    """The parameters of a part; for a long table of numbers the first and the last."""
    groups: dict[str, list[str]] = {}
    for path in _below(tree, "parts.NAME."):
        groups.setdefault(path.split(".")[2] if path.count(".") > 2 else "", []).append(path)
    shown = []
    for head, group in groups.items():
        shown += [group[0], group[-1]] if head and len(group) > _LONG_TABLE else group
    return _table(("parameter", "what", "unit", "default", "bounds"), [_row(tree, path)[:5] for path in shown])


def effects_page() -> str:
    """The page of every effect of every family: path, title, unit, neutral value, bounds, probe."""
    parts = [f"# Effects\n\n{_OF_EFFECTS}\n"]
    for family, title, note in _FAMILIES:
        tree = effects_by_kind()[family]
        paths = [path for path in list_paths(tree) if not path.startswith("discovered.")]
        parts.append(f"## {title}\n\n{note}\n\n{_effect_table(tree, paths, 'effects.')}")
    return "\n".join(parts)


def _effect_table(tree: Any, paths: list[str], head: str = "") -> str:
    rows = [(f"`{head}{path}`", *_row(tree, path)[1:]) for path in paths]
    return _table(("path", "effect", "unit", "neutral", "bounds", "probe"), rows)


def _row(tree: Any, path: str) -> tuple[str, ...]:
    """The row of a parameter: path, title, unit, default, bounds, probe."""
    spec = spec_at(tree, path)
    low, high = spec.bounds
    probe = f"{spec.probe:g}" if spec.probe else ""
    return f"`{path}`", spec.title, spec.unit, f"{spec.neutral:g}", f"{low:g} to {high:g}", probe


def channels_page() -> str:
    """The page of every channel: name, label, unit."""
    rows = [(f"`{name}`", channel.label, channel.unit) for name, channel in CHANNELS.items()]
    return f"# Channels\n\n{_OF_CHANNELS}\n\n" + _table(("channel", "what", "unit"), rows)


def commands_page() -> str:
    """The page of every command of `auv-gym` with its arguments and options."""
    from typer.main import get_command

    from auv_gym.cli import app

    root: Any = get_command(app)
    parts = ["# Commands\n\nWhat `auv-gym COMMAND --help` says.\n"]
    for name in sorted(root.commands):
        command = root.commands[name]
        rows = []
        for parameter in command.params:
            named = ", ".join(f"`{option}`" for option in (*parameter.opts, *parameter.secondary_opts))
            named = f"`{parameter.name.upper()}`" if parameter.param_type_name == "argument" else named
            rows.append((named, getattr(parameter, "help", "") or ""))
        text = re.sub(r"^ +", "", command.help or "", flags=re.MULTILINE)
        parts.append(f"## auv-gym {name}\n\n{text}\n\n{_table(('argument', 'meaning'), rows)}")
    return "\n".join(parts)


def _beside(name: str) -> str:
    """A Markdown file from outside docs/, with its links adapted."""
    text = (_ROOT / name).read_text().replace("](docs/", "](")
    return text.replace("](CHANGELOG.md)", "](changelog.md)").replace("](CONTRIBUTING.md)", "](contributing.md)")


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, tuple("---" for _ in head), *rows]
    return (
        "\n".join(
            "| " + " | ".join(cell.replace("|", "\\|").replace("\n", " ") for cell in row) + " |" for row in lines
        )
        + "\n"
    )


if __name__ == "__main__":
    write(_ROOT / "build" / "docs")
