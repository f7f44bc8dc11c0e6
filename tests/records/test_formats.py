import pytest

from auv_gym.records import formats as formats_module
from auv_gym.records.formats import format_of, formats, known_endings
from auv_gym.records.log import Format, Group, Log


def test_all_entry_points_can_be_imported():
    names = {found.name for found in formats()}
    assert formats_module._loaded()[1] == ""
    assert {
        "ROS 1 bag", "ROS 2 bag", "MCAP", "PX4 ULog", "MOOS log", "Seaglider NetCDF", "NetCDF", "MAT", "Slocum log",
        "SeaExplorer file", "ArduPilot dataflash log", "MAVLink telemetry log", "CSV or another table in text",
    } <= names  # fmt: skip
    assert ".bag" in known_endings()


def test_a_foreign_reader_that_cannot_be_imported_leaves_the_others_alone(monkeypatch, tmp_path):
    class Broken:
        name, value = "theirs", "their_package:FORMAT"

        def load(self):
            raise SyntaxError("not Python")

    real = formats_module.entry_points
    monkeypatch.setattr(formats_module, "entry_points", lambda group: [Broken(), *real(group=group)])
    formats_module._loaded.cache_clear()
    formats_module.formats.cache_clear()
    try:
        table = tmp_path / "log.csv"
        table.write_text("time_s,depth_m\n0,1\n1,2\n")
        assert format_of(table).name.startswith("CSV")
        odd = tmp_path / "log.xyz"
        odd.write_bytes(b"\0\1\2")
        with pytest.raises(ValueError, match=r"'\.xyz', which is no known format.*theirs .*cannot be imported"):
            format_of(odd)
    finally:
        formats_module._loaded.cache_clear()
        formats_module.formats.cache_clear()


def test_a_file_of_no_known_format_is_to_be_saved_as_a_table_first_of_all(tmp_path):
    odd = tmp_path / "log.parquet"
    odd.write_bytes(b"PAR1\0")
    with pytest.raises(ValueError, match=r"no known format\. Save it as CSV, or give one of these: \."):
        format_of(odd)


def test_each_ending_is_listed_once():
    endings = [word.strip(",") for word in known_endings().split() if word.startswith(".")]
    assert len(endings) == len(set(endings))
    assert {".nc", ".asc", ".csv"} <= set(endings)
    assert ".nc (NetCDF or Seaglider NetCDF)" in known_endings()


def test_a_folder_is_one_log_or_none(tmp_path):
    with pytest.raises(ValueError, match=r"is a folder, and not itself a log.*give the path of one log file in it\.$"):
        format_of(tmp_path)


def test_the_content_tells_the_format_whatever_a_file_is_called(tmp_path):
    bag = tmp_path / "log.txt"
    bag.write_bytes(b"#ROSBAG V2.0\n" + bytes(100))
    assert format_of(bag).name == "ROS 1 bag"
    table = tmp_path / "log.bag"
    table.write_text("time_s,depth_m\n0,1\n1,2\n")
    with pytest.raises(
        ValueError, match=r"ends in '\.bag' \(ROS 1 bag\), but its content is something else: it begins with 'time"
    ):
        format_of(table)
    zeros = tmp_path / "log.mcap"
    zeros.write_bytes(bytes(5000))
    with pytest.raises(ValueError, match="begins with only zeros"):
        format_of(zeros)


def test_a_group_has_columns_of_one_length():
    with pytest.raises(ValueError, match="need one length"):
        Group("a", {"x": [1, 2], "y": [1]})
    group = Group("a", {"x": [1.0, 2.0]})
    assert group.rows == 2
    assert Log("f", "s", (group,)).column("x") == (group, [1.0, 2.0])
    assert Log("f", "s", (group,)).column("y") is None
    assert Format("f", (), lambda p, h: False, lambda p, s: Log("f", "s", ())).general is False
