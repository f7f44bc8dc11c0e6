"""What a reader makes of a file: the log, its groups by name, or the sentence that refuses it."""

from pathlib import Path

import pytest

from auv_gym.records.log import Format, Group, Log, Scope


def outcome(form: Format, path: Path) -> Log | str:
    """The log in a file, or the sentence that refuses it."""
    try:
        return form.read(path, Scope())
    except ValueError as error:
        return str(error)


def groups(log: Log) -> dict[str, Group]:
    return {group.name: group for group in log.groups}


def check_refused(form: Format, path: Path, words: str, capfd) -> None:
    """Check that a file is refused in a sentence that names it, with nothing printed and nothing written beside it."""
    with pytest.raises(ValueError, match=words) as refused:
        form.read(path, Scope())
    assert str(path) in str(refused.value)
    assert [*path.parent.iterdir()] == [path]
    assert capfd.readouterr() == ("", "")
