"""A file is written whole or not at all."""

import json
import os
import stat
from pathlib import Path

import numpy as np
import pytest

from auv_gym.writing import finite, no_empty_folders, replacing, writable_folder, write_json


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_file_appears_when_all_is_written(tmp_path):
    with replacing(tmp_path / "a.txt") as new:
        new.write_text("half")
        assert new.parent == tmp_path  # a rename across file systems would be a copy, which can stop half way
        assert not (tmp_path / "a.txt").exists()
        new.write_text("whole")
    assert (tmp_path / "a.txt").read_text() == "whole"
    assert names(tmp_path) == ["a.txt"]


@pytest.mark.parametrize("crash", [RuntimeError, KeyboardInterrupt])
def test_a_crash_in_the_middle_leaves_the_old_file_and_nothing_else(tmp_path, crash):
    (tmp_path / "a.txt").write_text("old")

    def write_half():
        with replacing(tmp_path / "a.txt") as new:
            new.write_text("ha")
            raise crash

    with pytest.raises(crash):
        write_half()
    assert (tmp_path / "a.txt").read_text() == "old"
    assert names(tmp_path) == ["a.txt"]


def test_a_full_disk_is_said_in_words(tmp_path):
    def write_too_much():
        with replacing(tmp_path / "a.txt"):
            raise OSError(28, "No space left on device")

    with pytest.raises(ValueError, match=r"Cannot write .*a\.txt: No space left on device\. Choose a folder"):
        write_too_much()
    assert names(tmp_path) == []


@pytest.mark.parametrize("place, words", [("none/a.txt", "No such file or directory"), ("", "Is a directory")])
def test_what_cannot_be_replaced_is_refused_by_name(tmp_path, place, words):
    folder = tmp_path / "folder"
    folder.mkdir()
    with pytest.raises(ValueError, match=f"Cannot write .*: {words}"), replacing(folder / place) as new:
        new.write_text("text")
    assert names(tmp_path) == ["folder"]
    assert names(folder) == []


def test_two_writers_of_one_file_do_not_mix(tmp_path):
    with replacing(tmp_path / "a.txt") as one, replacing(tmp_path / "a.txt") as two:
        one.write_text("one")
        two.write_text("two")
        assert one != two
    assert (tmp_path / "a.txt").read_text() == "one"  # the outer block ends last
    assert names(tmp_path) == ["a.txt"]


def test_the_file_may_be_read_by_whom_the_system_lets(tmp_path):
    (tmp_path / "plain").write_text("")
    with replacing(str(tmp_path / "a.txt")) as new:
        new.write_text("text")
    modes = [stat.S_IMODE(os.stat(tmp_path / name).st_mode) for name in ("plain", "a.txt")]
    assert modes[0] == modes[1]


def test_plain_data_is_written_as_json_without_numbers_that_json_does_not_have(tmp_path):
    told = {"sizes": (1.5, np.float64(np.nan)), "counts": [3, -np.inf], "name": "drag", "sure": True, "none": None}
    assert finite(told) == {"sizes": [1.5, None], "counts": [3, None], "name": "drag", "sure": True, "none": None}
    write_json(tmp_path / "a.json", finite(told))
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == finite(told)
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "a.json", told)
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_folders_in_which_nothing_was_written_do_not_stay(tmp_path):
    (tmp_path / "mine").mkdir()

    def stop(write):
        with no_empty_folders():
            writable_folder(tmp_path / "mine")
            writable_folder(tmp_path / "a" / "b" / "c")
            if write:
                write_json(tmp_path / "a" / "a.json", {})
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop(write=False)
    assert names(tmp_path) == ["mine"]  # it was there before
    with pytest.raises(KeyboardInterrupt):
        stop(write=True)
    assert names(tmp_path / "a") == ["a.json"]
