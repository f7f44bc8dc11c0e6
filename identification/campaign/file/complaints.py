"""Validation of content against a model of settings, with error messages that name the key."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError

from auv_gym.param import did_you_mean

# Pydantic's types in the words of the campaign file.
_WANTED = {
    "float_type": "a number",
    "int_type": "a whole number",
    "bool_type": "true or false",
    "string_type": "text in quotes",
    "tuple_type": "a list",
    "list_type": "a list",
    "dict_type": "a table",
    "model_type": "a table",
    "model_attributes_type": "a table",
    "finite_number": "a finite number",
}


def checked(model: type[BaseModel], content: Mapping[str, Any], where: str) -> Any:
    """Content as a model; raises ValueError with one line for each wrong key."""
    try:
        # through JSON, where a list may be a tuple, but no other type is converted
        return model.model_validate_json(json.dumps(content, default=str))
    except ValidationError as error:
        raise ValueError(f"{where}: " + "\n".join(_lines(model, error))) from None


def _lines(model: type[BaseModel], error: ValidationError) -> list[str]:
    """One line for each wrong key; alternatives of a union share a line."""
    wanted: dict[str, list[str]] = {}
    came: dict[str, str] = {}
    for problem in error.errors():
        key, owner = _place(model, problem["loc"])
        form, got = _in_words(problem, model, owner)
        wanted.setdefault(key, []).append(form)
        came[key] = got
    deepest = [key for key in wanted if not any(other.startswith(f"{key}.") for other in wanted)]
    lines = []
    for key in deepest:
        first, *others = dict.fromkeys(wanted[key])
        rest = "".join(f" or {other.removeprefix(' needs ')}" for other in others)
        lines.append(f"{key}{first}{rest}{came[key]}".lstrip(": "))
    return lines


def _in_words(problem: Any, model: type[BaseModel], owner: Any) -> tuple[str, str]:
    """One of pydantic's problems in words: what was needed, to follow the key or ` or `, and what came."""
    kind, context, came = problem["type"], problem.get("ctx", {}), problem["input"]
    if kind == "extra_forbidden":
        known = _keys(owner)
        return f": unknown key. {did_you_mean(str(problem['loc'][-1]), known)}Known: {', '.join(known)}.", ""
    if kind == "missing":
        return " is missing: add it.", ""
    if kind == "value_error":
        return f": {context['error']}.", ""
    if kind == "union_tag_not_found":
        return f".kind is missing: give one of {_tags(model, problem['loc'])}.", ""
    wanted = context.get("expected_tags", context.get("expected", ""))
    if kind == "union_tag_invalid":
        hint = did_you_mean(str(context["tag"]), re.findall(r"'([^']*)'", wanted))
        return f".kind needs one of {wanted}", f", got {context['tag']!r}. {hint}".rstrip()
    hint = did_you_mean(str(came), re.findall(r"'([^']*)'", wanted)) if kind == "literal_error" else ""
    if kind == "too_short":
        wanted = f"{context['min_length']} or more items"
    elif kind == "too_long":
        wanted = f"no more than {context['max_length']} items"
    elif kind in ("greater_than", "greater_than_equal"):
        wanted = f"a number above {context['gt']:g}" if "gt" in context else f"a number of at least {context['ge']:g}"
    elif kind != "literal_error":
        wanted = _WANTED.get(kind, problem["msg"].removeprefix("Input should be "))
    return f" needs {wanted}", f", got {came!r}. {hint}".rstrip()


def _place(model: Any, loc: Sequence[Any]) -> tuple[str, Any]:
    """The dotted key of a problem, without pydantic's names of union members, and the model that has the key."""
    names: list[str] = []
    owner: Any = model
    here: Any = model
    for name in loc:
        members = _members(here)
        tables = {_tag(member): member for member in members if _is_table(member)}
        if len(members) > 1 and name in tables:
            here = tables[name]
            continue
        if len(members) > 1 and not tables and isinstance(name, str) and not _is_mapping(members):
            continue  # the name of a plain union member: tuple[...], literal[...]
        names.append(str(name))
        table = next((member for member in members if _is_table(member)), None)
        if table is not None:
            owner = table
            by_key = {field.alias or key: field for key, field in table.model_fields.items()}
            here = by_key[name].annotation if name in by_key else Any
        else:
            here = next((get_args(m)[-1 if get_origin(m) is dict else 0] for m in members if get_args(m)), Any)
    return ".".join(names), owner


def _members(annotation: Any) -> list[Any]:
    """The types that an annotation allows, except None."""
    if get_origin(annotation) is Annotated:
        return _members(get_args(annotation)[0])
    if get_origin(annotation) in (Union, UnionType):
        return [inner for member in get_args(annotation) if member is not type(None) for inner in _members(member)]
    return [annotation]


def _is_table(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _is_mapping(members: Sequence[Any]) -> bool:
    return any(get_origin(member) is dict for member in members)


def _tag(table: type[BaseModel]) -> str:
    kind = table.model_fields.get("kind")
    return get_args(kind.annotation)[0] if kind is not None and get_args(kind.annotation) else table.__name__


def _tags(model: Any, loc: Sequence[Any]) -> str:
    annotation: Any = model
    for name in loc:
        annotation = annotation.model_fields[name].annotation
    return ", ".join(repr(_tag(member)) for member in _members(annotation))


def _keys(owner: Any) -> list[str]:
    return [field.alias or key for key, field in owner.model_fields.items()] if _is_table(owner) else []
