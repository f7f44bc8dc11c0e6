"""Parameters declared once, with unit, bounds and probe, and the paths to read, replace and list them.

A parameter tree consists of frozen dataclasses with `param` fields, the leaves, and groups of them.  A path names a
leaf from the root, such as `effects.rudder.offset`.  An object that keeps its tree in a field `parameters` (a Plant)
accepts the same paths.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeVar, get_type_hints

import numpy as np

T = TypeVar("T")
_LISTED_AT_ONCE = 60


class Spec(NamedTuple):
    """The declaration of a parameter; `neutral` is the declared default."""

    unit: str
    title: str
    neutral: float
    bounds: tuple[float, float]
    probe: float
    apart: str = ""


def param(
    default: float,
    unit: str,
    title: str = "",
    *,
    bounds: tuple[float, float] = (-math.inf, math.inf),
    probe: float = 0.0,
    apart: str = "",
) -> Any:
    """A dataclass field that holds a float parameter.

    title: for reports.  bounds: the physically meaningful values.  probe: a small change that matters, the step of
    fits; 0 for a parameter that no fit may free.  apart: for an effect, the data that would set it apart from similar
    ones.
    """
    return dataclasses.field(default=default, metadata={"spec": Spec(unit, title, default, bounds, probe, apart)})


def part(group: type, subject: str = "") -> Any:
    """A dataclass field that holds a group of parameters; `{}` in their titles is replaced by the subject."""
    return dataclasses.field(default_factory=group, metadata={"group": group, "subject": subject})


def list_paths(tree: Any) -> list[str]:
    """All parameter paths of a tree (or of the object that keeps it), in the order of the packed vector.

    Example:

        >>> from auv_gym import list_paths, load_vehicle
        >>> list_paths(load_vehicle("slocum"))[:3]
        ['hull.density', 'hull.length', 'hull.mass']
    """
    return [path for path, _ in _specs(type(_tree(tree)))]


def spec_at(tree: Any, path: str) -> Spec:
    """Unit, title, neutral value, bounds and probe of the parameter at a path; raises on an unknown path.

    Example:

        >>> from auv_gym import load_vehicle, spec_at
        >>> spec = spec_at(load_vehicle("slocum"), "effects.rudder.offset")
        >>> spec.unit, spec.neutral
        ('rad', 0.0)
    """
    specs = _by_path(type(_tree(tree)))
    if path not in specs:
        raise _unknown_path(path, specs)
    return specs[path]


def value_at(tree: Any, path: str) -> float:
    """The value at a path; raises on an unknown path.

    Example:

        >>> from auv_gym import load_vehicle, value_at
        >>> value_at(load_vehicle("slocum"), "effects.rudder.gain")
        1.0
    """
    spec_at(tree, path)
    node = _tree(tree)
    for name in path.split("."):
        node = getattr(node, name)
    return float(node)


def replace_at(tree: T, path: str | Mapping[str, float], value: float | None = None) -> T:
    """A copy with one value replaced, or several, given as a mapping; raises on an unknown path or a bad value.

    Example:

        >>> from auv_gym import load_vehicle, replace_at
        >>> bent = replace_at(load_vehicle("slocum"), "effects.rudder.offset", 0.03)
        >>> bent.effects.rudder.offset
        0.03
    """
    changes = path if isinstance(path, Mapping) else {path: value}
    for name, new in changes.items():
        spec = spec_at(tree, name)
        check_value(name, new, spec)
        tree = _replaced(tree, ["parameters", *name.split(".")] if _tree(tree) is not tree else name.split("."), new)
    return tree


def check_value(path: str, value: Any, spec: Spec) -> float:
    """The value as a float; raises if it is not a finite number within the parameter's bounds."""
    low, high = spec.bounds
    if isinstance(value, bool) or not isinstance(value, int | float | np.floating | np.integer):
        raise ValueError(f"{path} needs a number{in_unit(spec.unit)}, got {value!r}: give a plain number.")
    if not math.isfinite(value) or not low <= value <= high:
        raise ValueError(
            f"{path} needs a value from {low:g} to {high:g}{in_unit(spec.unit, '')}, got {value:g}: check its unit and "
            "sign."
        )
    return float(value)


def check_number(
    name: str,
    value: Any,
    unit: str,
    *,
    above: float = -math.inf,
    at_least: float = -math.inf,
    at_most: float = math.inf,
) -> None:
    """Raise if a setting is not a finite number within its bounds."""
    number = isinstance(value, int | float | np.floating | np.integer) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or not (value > above and at_least <= value <= at_most):
        words = (("above", above), ("of at least", at_least), ("of at most", at_most))
        bounds = " and ".join(f"{word} {bound:g}" for word, bound in words if math.isfinite(bound))
        raise ValueError(f"{name} needs a number{' ' * bool(bounds)}{bounds}{in_unit(unit)}, got {value!r}.")


def check_count(name: str, value: Any, least: int = 1) -> None:
    """Raise if a setting is not a whole number of at least `least`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ValueError(f"{name} needs a whole number of at least {least}, got {value!r}.")


def check_names(name: str, given: Any) -> None:
    """Raise if a setting is not a list of names; a text alone would be taken for the list of its letters."""
    if isinstance(given, str):
        raise ValueError(f"{name} needs a list of names, got the text {given!r}: write [{given!r}].")
    if not isinstance(given, Collection) or not all(isinstance(one, str) for one in given):
        raise ValueError(f"{name} needs a list of names, got {given!r}.")


def in_unit(unit: str, word: str = " in") -> str:
    """A unit as it follows a word in an error: ` in rad`; empty for a number without unit."""
    if unit == "channel's":
        return " in the channel's unit"
    return "" if unit == "1" else f"{word} {unit}"


def pack(tree: Any) -> np.ndarray:
    """All values of the tree as a flat float64 vector, shape (n,), in the order of `list_paths`."""
    tree = _tree(tree)
    return np.fromiter(_values(tree), dtype=np.float64)


def positions(tree: Any) -> dict[str, int]:
    """Path to index in the packed vector."""
    return {path: index for index, path in enumerate(list_paths(tree))}


def record_type(tree_type: Any) -> np.dtype:
    """The record dtype of a parameter tree, nested like its dataclasses; every leaf is a float64.

    A group whose class has `as_array = True` becomes one array field in the order of its leaves.
    """
    if getattr(tree_type, "as_array", False):
        return np.dtype((np.float64, (len(_specs(tree_type)),)))
    fields = []
    for field in dataclasses.fields(tree_type):
        leaf = "spec" in field.metadata
        fields.append((field.name, np.float64 if leaf else record_type(_group_of(tree_type, field))))
    return np.dtype((np.record, fields))


def did_you_mean(word: str, known: Any) -> str:
    """`Did you mean 'slocum'? ` for an error text, or an empty string."""
    close = difflib.get_close_matches(word, list(known), n=3, cutoff=0.6)
    return f"Did you mean {' or '.join(repr(c) for c in close)}? " if close else ""


def listed(items: Sequence[str], word: str = "and") -> str:
    """Items as a list in words: `a, b and c`, or with another conjunction."""
    return f" {word} ".join([", ".join(items[:-1]), items[-1]]) if len(items) > 1 else "".join(items)


def _tree(tree: Any) -> Any:
    return tree.parameters if hasattr(tree, "parameters") else tree


@lru_cache
def _specs(tree_type: Any) -> tuple[tuple[str, Spec], ...]:
    if not dataclasses.is_dataclass(tree_type):
        raise ValueError(f"Parameters belong to a vehicle, got a {tree_type.__name__}: load_vehicle reads one by name.")
    found: list[tuple[str, Spec]] = []
    for field in dataclasses.fields(tree_type):
        if "spec" in field.metadata:
            found.append((field.name, field.metadata["spec"]))
        else:
            subject = field.metadata.get("subject", "")
            for path, spec in _specs(_group_of(tree_type, field)):
                title, apart = (words.replace("{}", subject) for words in (spec.title, spec.apart))
                found.append((f"{field.name}.{path}", spec._replace(title=title, apart=apart)))
    return tuple(found)


@lru_cache
def _by_path(tree_type: type) -> dict[str, Spec]:
    return dict(_specs(tree_type))


def _group_of(tree_type: type, field: dataclasses.Field) -> type:
    return field.metadata.get("group") or get_type_hints(tree_type)[field.name]


def _values(tree: Any) -> Iterator[float]:
    for field in dataclasses.fields(tree):
        value = getattr(tree, field.name)
        if "spec" in field.metadata:
            yield float(value)
        else:
            yield from _values(value)


def _replaced(tree: Any, names: list[str], value: Any) -> Any:
    inner = float(value) if len(names) == 1 else _replaced(getattr(tree, names[0]), names[1:], value)
    return dataclasses.replace(tree, **{names[0]: inner})


def _unknown_path(path: str, known: Any) -> ValueError:
    hint = did_you_mean(path, known)
    group = path.rpartition(".")[0]
    while group and not any(name.startswith(f"{group}.") for name in known):
        group = group.rpartition(".")[0]
    # list the neighbours of the path, or the groups: a six-degree-of-freedom vehicle has hundreds of parameters
    near = [name for name in known if name.startswith(f"{group}.")] if group else list(known)
    if len(near) > _LISTED_AT_ONCE:
        depth = group.count(".") + 2 if group else 2
        near = list(dict.fromkeys(".".join(name.split(".")[:depth]) for name in near))
    return ValueError(f"No parameter {path!r}. {hint}Known: {', '.join(near)}.")
