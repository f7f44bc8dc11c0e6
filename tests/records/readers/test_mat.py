"""MAT files: the set of vectors that has a time, text in cells, and what is refused."""

import numpy as np
import pytest
from scipy.io import savemat

from auv_gym.records.log import Scope
from auv_gym.records.readers.mat import FORMAT
from auv_gym.records.reading import read_record

SIGNALS = {"time_s": np.arange(10.0), "heading_deg": 36.0 * np.arange(10), "gain": 3.0}


def save(path, content, **kwargs):
    savemat(path, content, **kwargs)
    return path


@pytest.mark.parametrize("form", ["5", "4"])
@pytest.mark.parametrize("packed", [False, True])
def test_vectors_of_one_length(tmp_path, form, packed):
    path = save(tmp_path / "log.mat", SIGNALS, format=form, **({"do_compression": packed} if form == "5" else {}))
    assert FORMAT.recognises(path, path.read_bytes()[:4096])
    (group,) = FORMAT.read(path, Scope()).groups
    assert (group.name, group.time, group.rows, group.units) == ("", None, 10, {})
    assert group.columns["time_s"].tolist() == SIGNALS["time_s"].tolist()
    assert group.columns["heading_deg"].tolist() == SIGNALS["heading_deg"].tolist()
    assert set(group.columns) == {"time_s", "heading_deg"}


def test_a_structure_with_labels(tmp_path):
    labels = np.array(["a"] * 4 + ["b"] * 6, dtype=object)
    mixed = np.array([1.0, 2.5] * 5, dtype=object)
    path = save(tmp_path / "log.mat", {"log": {**SIGNALS, "dive_id": labels, "cells": mixed}, "note": "x"})
    (group,) = FORMAT.read(path, Scope()).groups
    assert group.name == "log"
    assert group.columns["dive_id"] == ["a"] * 4 + ["b"] * 6
    assert group.columns["cells"].tolist() == [1.0, 2.5] * 5
    (first,) = FORMAT.read(path, Scope(most=3)).groups
    assert (first.rows, len(first.columns["heading_deg"])) == (10, 3)
    assert FORMAT.read(path, Scope(groups={"other"})).groups == ()


def test_without_a_time_all_sets_come_for_a_mapping(tmp_path):
    path = save(
        tmp_path / "log.mat", {"t": np.arange(5.0), "depth_m": np.arange(5.0)[:, None], "imu": {"r": np.ones(9)}}
    )
    log = FORMAT.read(path, Scope())
    assert [(group.name, sorted(group.columns)) for group in log.groups] == [("", ["depth_m", "t"]), ("imu", ["r"])]


def test_vectors_of_other_lengths_are_left_out_with_a_note(tmp_path):
    path = save(tmp_path / "log.mat", {**SIGNALS, "waypoints": np.arange(4.0)})
    log = FORMAT.read(path, Scope())
    assert set(log.names) == {"time_s", "heading_deg"}
    assert log.notes == ("Left out, as they are not as long as the others (10): waypoints (4).",)
    save(path, {"time_s": np.arange(5.0), "depth_m": np.arange(6.0)})
    with pytest.raises(ValueError, match=r"All vectors need one length, got \{'time_s': 5, 'depth_m': 6\}"):
        FORMAT.read(path, Scope())


def test_structures_with_a_time_each_are_a_group_each(tmp_path):
    path = save(tmp_path / "log.mat", {"gps": SIGNALS, "imu": SIGNALS})
    groups = FORMAT.read(path, Scope()).groups
    assert [group.name for group in groups] == ["gps", "imu"]
    assert set(groups[1].columns) == {"imu.time_s", "imu.heading_deg"}
    with pytest.raises(ValueError, match="A set of vectors with a time is needed; there are gain"):
        FORMAT.read(save(path, {"gain": 3.0}), Scope())


def test_the_messages_of_a_mission_become_one_record(tmp_path):
    time = 1.7e9 + np.arange(50.0)
    slow = {"timestamp": time[::2], "phi": 0 * time[::2], "theta": 0 * time[::2] + 0.1, "psi": 0.01 * time[::2] % 6.0}
    path = save(
        tmp_path / "Data.mat", {"EulerAngles": slow, "Depth": {"timestamp": time, "value": 0.1 * (time - 1.7e9)}}
    )
    record = read_record(path, {"Depth.value": "depth_m"})
    assert record["pitch_rad"] == pytest.approx(0.1)
    assert record["depth_m"] == pytest.approx(0.2 * np.arange(25.0))
    assert record.attrs["start_epoch_s"] == pytest.approx(1.7e9)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.9, 0.99])
@pytest.mark.parametrize("packed", [False, True])
def test_a_file_that_is_cut_short_is_refused(tmp_path, share, packed):
    noise = np.random.default_rng(1).normal(size=500)
    whole = save(tmp_path / "whole.mat", {"time_s": np.arange(500.0), "x": noise}, do_compression=packed).read_bytes()
    path = tmp_path / "cut.mat"
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(ValueError, match=r"damaged or cut short .*: save it again with -v7"):
        FORMAT.read(path, Scope())


def test_garbage_inside_raises_no_other_error(tmp_path):
    whole = save(tmp_path / "whole.mat", SIGNALS).read_bytes()
    random, path, refused = np.random.default_rng(2), tmp_path / "bad.mat", 0
    for where in range(124, len(whole) - 16, 8):
        path.write_bytes(whole[:where] + random.bytes(16) + whole[where + 16 :])
        try:
            FORMAT.read(path, Scope())
        except ValueError:
            refused += 1
    assert refused > 2


@pytest.mark.parametrize("start", [b"MATLAB 5.0 MAT-file", b""])
def test_zeros_are_refused_at_once(tmp_path, start):
    path = tmp_path / "zeros.mat"
    with path.open("wb") as file:
        file.write(start.ljust(124) + b"\0\1IM" if start else b"")
        file.truncate(1 << 30)
    with pytest.raises(ValueError, match=r"damaged or cut short|One set of vectors"):
        FORMAT.read(path, Scope())


def test_what_is_not_read(tmp_path):
    new = tmp_path / "new.mat"
    new.write_bytes(b"MATLAB 7.3 MAT-file" + bytes(600))
    assert FORMAT.recognises(new, new.read_bytes())
    with pytest.raises(ValueError, match=r"version 7\.3 are not read: save with"):
        FORMAT.read(new, Scope())
    text = tmp_path / "text.mat"
    text.write_text("time_s,depth_m\n0,1\n1,2\n2,3\n")
    assert not FORMAT.recognises(text, text.read_bytes())
    assert not FORMAT.recognises(tmp_path / "short.mat", b"MAT")
    assert not FORMAT.recognises(tmp_path / "log.csv", bytes(64))
