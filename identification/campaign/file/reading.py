"""Reading a campaign from its file, and the settings for a point of the grid."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel

from auv_gym.param import did_you_mean
from identification.campaign.file.complaints import checked
from identification.campaign.file.settings import Campaign, Head, RunSettings

T = TypeVar("T", bound=BaseModel)

# Tables whose keys are dotted paths: `[sensors] depth.noise = 0.1` and "depth.noise" = 0.1 mean the same.
_PATHS = (("vehicle", "effects"), ("sensors",), ("experiment", "randomise"), ("grid",))
_CAMPAIGN_KEYS = ("name", "description", "seeds", "grid", "fit", "compare", "tune")


def read_campaign(path: str | Path, seed_offset: int = 0) -> Campaign:
    """The campaign in a file; raises ValueError that lists every wrong key, what came and what is allowed.

    seed_offset: added to every seed, including the seeds in filters.  The runs' own settings are checked by `plan`,
    with the grid's values inserted.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
        content = tomllib.loads(text)
    except FileNotFoundError:
        raise ValueError(f"There is no campaign file {path}.") from None
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"Cannot read the campaign file {path}: {error}.") from None
    except tomllib.TOMLDecodeError as error:
        raise ValueError(f"The campaign file {path} is not valid TOML: {error}.") from None
    known = (*_CAMPAIGN_KEYS, *(name for name in RunSettings.model_fields if name != "seed"))
    for key in content:
        if key not in known:
            raise ValueError(f"{path}: unknown key {key!r}. {did_you_mean(key, known)}Known: {', '.join(known)}.")
    for at in _PATHS:
        _flatten(content, at)
    head = checked(Head, {key: content[key] for key in _CAMPAIGN_KEYS if key in content}, str(path))
    seeds = head.seeds if isinstance(head.seeds, tuple) else tuple(range(head.seeds))
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"{path}: seeds names a seed twice: {list(seeds)}.")
    if min(seeds) + seed_offset < 0:
        raise ValueError(f"{path}: seeds moved by {seed_offset} begin below 0: choose a larger offset.")
    return Campaign(
        path=path,
        text=text,
        name=head.name,
        description=head.description,
        seeds=tuple(seed + seed_offset for seed in seeds),
        grid=head.grid,
        fit=tuple(_moved(fit, ("runs", "validate_on"), seed_offset) for fit in head.fit),
        compare=None if head.compare is None else _moved(head.compare, ("runs",), seed_offset),
        tune=head.tune,
        template={key: value for key, value in content.items() if key not in _CAMPAIGN_KEYS},
    )


def _moved(table: T, filters: Sequence[str], seed_offset: int) -> T:
    """A table with the seeds in its filters shifted by an offset."""
    changes = {}
    for name in filters:
        wanted = getattr(table, name)
        if wanted and "seeds" in wanted:
            seeds = wanted["seeds"]
            moved = [
                s + seed_offset if isinstance(s, int) else s for s in (seeds if isinstance(seeds, list) else [seeds])
            ]
            changes[name] = {**wanted, "seeds": moved}
    return table.model_copy(update=changes)


def with_value(content: Mapping[str, Any], key: str, value: Any) -> dict[str, Any]:
    """Content with the value at a dotted key, made of keys of tables and positions in lists; raises if there is none.

    Missing tables along the key are created.
    """
    changed = json.loads(json.dumps(content))
    names = key.split(".")
    for at in _PATHS:
        if tuple(names[: len(at)]) == at and len(names) > len(at):
            names = [*at, ".".join(names[len(at) :])]
    node: Any = changed
    for depth, name in enumerate(names):
        at: Any = name
        if isinstance(node, list):
            if not name.isdigit() or int(name) >= len(node):
                where = ".".join(names[:depth])
                raise ValueError(f"The grid's key {key!r} needs a number from 0 to {len(node) - 1} after {where!r}.")
            at = int(name)
        elif not isinstance(node, dict):
            raise ValueError(f"The grid's key {key!r} leads into {'.'.join(names[:depth])!r}, which is no table.")
        if depth == len(names) - 1:
            node[at] = value
        else:
            node = node[at] if isinstance(node, list) else node.setdefault(name, {})
    return changed


def _flatten(content: dict[str, Any], at: Sequence[str]) -> None:
    """Flatten the tables within the table at a path into one table with dotted keys, in place."""
    for name in at[:-1]:
        content = content.get(name, {})
        if not isinstance(content, dict):
            return
    table = content.get(at[-1])
    if isinstance(table, dict):
        content[at[-1]] = dict(_leaves(table, ""))


def _leaves(table: Mapping[str, Any], prefix: str) -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value
