"""Pages of the documentation that are made, not written: effects, channels, commands, and the files beside docs/.

A hook of mkdocs, see `mkdocs.yml`; `make docs` builds the site.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from auv_gym.channels import CHANNELS
from auv_gym.param import list_paths, spec_at
from auv_gym.plant import load_vehicle

_ROOT = Path(__file__).parents[1]
_OF_EFFECTS = """
Every effect is in every simulation, neutral until it is set: `effects={PATH: VALUE}` of an environment,
`--effect PATH=VALUE` of `auv-gym simulate`, `replace_at(plant, PATH, VALUE)` in Python. *Probe* is the smallest change
worth detecting; an effect without one is a setting of the others and no candidate of a diagnosis. The command
`auv-gym list effects` prints the same.
""".strip()
_OF_CHANNELS = """
Records, models, environments and reports name their signals by these, in SI and radians. The columns of a file may be
in other units, by suffix (`heading_deg`, `speed_kn`, `pressure_dbar`).
""".strip()
_FAMILIES = (
    ("Gliders", "slocum", "The heading of a glider."),
    (
        "Vehicles in six degrees of freedom",
        "npsauv",
        "Shown for `npsauv`, which has bow planes; a vehicle without has no `bow_plane`.",
    ),
    (
        "Profiling floats",
        "qiandao_float",
        "`effects.oil` acts where the engine is an oil bladder, `effects.piston` where it is a piston.",
    ),
)


def on_files(files: Any, config: Any) -> Any:
    """The files of the site with the made pages among them."""
    from mkdocs.structure.files import File

    made = {
        "reference/effects.md": effects_page(),
        "reference/channels.md": channels_page(),
        "reference/commands.md": commands_page(),
        "contributing.md": _beside("CONTRIBUTING.md"),
        "changelog.md": _beside("CHANGELOG.md"),
    }
    for path, text in made.items():
        files.append(File.generated(config, path, content=text))
    return files


def effects_page() -> str:
    """Every effect of every family: path, words, unit, neutral value, bounds, probe."""
    parts = [f"# Effects\n\n{_OF_EFFECTS}\n"]
    for title, vehicle, note in _FAMILIES:
        plant = load_vehicle(vehicle)
        paths = [p for p in list_paths(plant) if p.startswith("effects.") and ".discovered." not in p]
        rows = []
        for path in paths:
            spec = spec_at(plant, path)
            low, high = spec.bounds
            probe = f"{spec.probe:g}" if spec.probe else ""
            rows.append((f"`{path}`", spec.title, spec.unit, f"{spec.neutral:g}", f"{low:g} to {high:g}", probe))
        parts.append(
            f"## {title}\n\n{note}\n\n{_table(('path', 'effect', 'unit', 'neutral', 'bounds', 'probe'), rows)}"
        )
    return "\n".join(parts)


def channels_page() -> str:
    """Every channel: name, words, unit."""
    rows = [(f"`{name}`", channel.label, channel.unit) for name, channel in CHANNELS.items()]
    return f"# Channels\n\n{_OF_CHANNELS}\n\n" + _table(("channel", "what", "unit"), rows)


def commands_page() -> str:
    """Every command of `auv-gym` with its arguments and options."""
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
    """A Markdown file beside docs/, its links as seen from there."""
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
