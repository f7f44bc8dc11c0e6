"""Arguments and options that take one of a few words; anything else is refused with those words."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Any

import typer


def choice(kind: type[StrEnum], help: str) -> Any:
    """An option that takes one of the words of an enumeration."""
    return typer.Option(help=help, parser=_reader(kind), metavar="|".join(kind))


def choice_argument(kind: type[StrEnum], help: str) -> Any:
    """An argument that takes one of the words of an enumeration."""
    return typer.Argument(help=help, parser=_reader(kind))


def _listed(kind: type[StrEnum]) -> str:
    *words, last = kind
    return f"{', '.join(words)} or {last}"


def _reader(kind: type[StrEnum]) -> Callable[[str], StrEnum]:
    """What reads a word of an enumeration."""

    def word(given: str) -> StrEnum:
        if given not in list(kind):
            from auv_gym.param import did_you_mean

            hint = did_you_mean(given, [one.value for one in kind])
            raise typer.BadParameter(f"{_listed(kind)} is needed, got {given!r}. {hint}".rstrip())
        return kind(given)

    return word
