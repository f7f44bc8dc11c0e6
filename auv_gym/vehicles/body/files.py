"""Parts of a body in a vehicle file's words: their kinds, forms, channels and curves."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from auv_gym.param import did_you_mean
from auv_gym.vehicles.body.body import Body, Part
from auv_gym.vehicles.body.compose import compose
from auv_gym.vehicles.body.kinds import part_kind, part_kinds
from auv_gym.vehicles.family import Family


def parse_part_tables(content: Mapping[str, Any]) -> tuple[Family, dict[str, Any]]:
    """The family of a file's parts, and the content as numbers only; raises ValueError for inconsistent content."""
    tables = content.get("parts", {})
    found, numbers = [], {}
    for name, table in tables.items():
        if not isinstance(table, Mapping):
            raise ValueError(f"parts.{name} needs a table with kind = ..., got {table!r}: write it as [parts.{name}]")
        try:
            part_, numbers[name] = _part(name, table)
        except ValueError as error:
            raise ValueError(f"parts.{name}: {error}") from None
        found.append(part_)
    try:
        family = compose(found)
    except ValueError as error:
        raise ValueError(f"parts: {error}") from None
    return family, {**content, **({"parts": numbers} if "parts" in content else {})}


def _part(name: str, table: Mapping[str, Any]) -> tuple[Part, dict[str, Any]]:
    if "kind" not in table:
        raise ValueError(f"kind is missing: give one of {', '.join(part_kinds())}")
    kind = table["kind"]
    if not isinstance(kind, str):
        raise ValueError(f"kind needs text in quotes, one of {', '.join(part_kinds())}, got {kind!r}")
    known = part_kinds().get(kind)
    choice = table.get(known.choice, "") if known else ""
    described = part_kind(kind, choice)
    channels = table.get("channel", ())
    channels = (channels,) if isinstance(channels, str) else tuple(channels)
    if channels and (len(channels) != len(described.commands) or not all(isinstance(c, str) for c in channels)):
        raise ValueError(f"channel needs the name of each of its {len(described.commands)} commands, got {channels!r}")
    numbers = {key: entry for key, entry in table.items() if key not in ("kind", "channel", described.choice)}
    for key, reader in described.texts.items():
        if key in numbers and not isinstance(numbers[key], Mapping):
            numbers[key] = dict(reader(numbers[key]))
    for key, entry in numbers.items():
        if isinstance(entry, str):
            texts = ["kind", "channel", *([described.choice] if described.choice else [])]
            raise ValueError(f"{key} is text, {entry!r}: {did_you_mean(key, texts)}only {', '.join(texts)} are")
    return Part(name, kind, choice, channels), numbers


def parts_text(body: Body | None) -> dict[str, list[str]]:
    """The first lines of each part's table, by the table's name."""
    said = {}
    for part_ in body.parts if body else ():
        lines = [f"kind = {json.dumps(part_.kind)}"]
        if part_.choice:
            lines.append(f"{part_.found.choice} = {json.dumps(part_.choice)}")
        if part_.channels:
            lines.append(f"channel = {json.dumps(list(part_.channels))}")
        said[f"parts.{part_.name}"] = lines
    return said
