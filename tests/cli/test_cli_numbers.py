"""Every option of every command that is a number: its help says a range, and nothing else is taken."""

import re
from types import NoneType
from typing import Annotated, get_args, get_origin, get_type_hints

import pytest

from auv_gym.cli import main
from auv_gym.cli.application import app


def is_number(hint) -> bool:
    return hint in (int, float) or any(is_number(part) for part in get_args(hint) if part is not NoneType)


def named(command) -> str:
    return command.name or command.callback.__name__.replace("_", "-")


def numbers():
    """Command, flag, help and whether it is whole, of all options and arguments that are numbers."""
    for command in app.registered_commands:
        for name, hint in get_type_hints(command.callback, include_extras=True).items():
            if name != "return" and get_origin(hint) is Annotated and is_number(hint.__origin__):
                (option,) = hint.__metadata__
                flag = next(iter(option.param_decls or ()), f"--{name.replace('_', '-')}")
                yield pytest.param(
                    named(command),
                    flag,
                    option.help,
                    int in (hint.__origin__, *get_args(hint.__origin__)) or list[int] in get_args(hint.__origin__),
                    id=f"{command.callback.__name__} {flag}",
                )


def refusal(capsys, *arguments) -> str:
    """What is said to a wrong use, without the frame around it."""
    assert main(arguments) == 2
    return " ".join(re.sub("[│╭╮╰╯─]", " ", capsys.readouterr().err).split())


@pytest.mark.parametrize("command, flag, help, whole", list(numbers()))
def test_a_number_has_a_range(command, flag, help, whole, capsys):
    said = re.search(r"Range: (from (\S+) to (\S+))\.$", help)
    assert said is not None, help
    words, least, most = said[1], float(said[2]), float(said[3])
    name = "whole number" if whole else "number"
    wrong = [f"{least - 1:.0f}", f"{2 * most + 1:.0f}", "nan", "inf", "much", *(["1.5"] if whole else [])]
    for value in wrong:
        error = refusal(capsys, command, f"{flag}={value}")
        assert f"Invalid value for '{flag}': a {name} {words} is needed, got {value}." in error
    for value in (said[2], said[3]):  # that pass, so that what is missing is found out
        assert "Missing" in refusal(capsys, command, f"{flag}={value}")


def test_there_are_numbers_in_every_command_but_those_that_show():
    found = {param.values[0] for param in numbers()}
    assert found == {named(command) for command in app.registered_commands} - {
        "list",
        "draw",
        "look",
        "export",
    }
