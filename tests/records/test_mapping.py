import numpy as np
import pytest

from auv_gym.records.log import Group, Log
from auv_gym.records.mapping import FIELD, YOURS, fitting_mappings, load_mapping, shipped, sources

ODOMETRY = ["pose.pose.position.x", "pose.pose.position.y", "pose.pose.position.z"]


def log(*groups):
    return Log("test", "test.log", groups)


def table(units=None, **columns):
    return Group("", {k: np.asarray(v, dtype=float) for k, v in columns.items()}, units=units or {})


def topic(name, fields, type="", frame="", rows=3):
    columns = {f"{name}.{field}": np.arange(float(rows)) for field in fields}
    return Group(name, columns, time=np.arange(float(rows)), type=type, frame=frame)


def taken(found):
    return {source.column: (source.target.name, source.target.factor, source.by) for source in found}


def test_a_mapping_renames_turns_scales_and_shifts():
    names = load_mapping({"a": "-rudder_deg", "b": {"to": "depth_m", "factor": 0.1, "offset": -10.0}, "c": ""})
    found, notes = sources(log(table(a=[1], b=[200], c=[3])), names)
    values = {s.channel.name: s.target.channel_and_values(s.group.columns[s.column])[1] for s in found}
    assert values["rudder_rad"] == pytest.approx([-np.radians(1)])
    assert values["depth_m"] == pytest.approx([10.0])
    assert all(source.by == YOURS for source in found)
    assert notes == []


@pytest.mark.parametrize(
    "mapping, words",
    [
        ({"a": ["depth_m"]}, r"got \['depth_m'\] for 'a'"),
        ({"a": True}, "got True"),
        ({"a": "-"}, "got '-'"),
        ({"a": {"to": "depth_m", "power": 2}}, "one text per column"),
        ({"a": {"factor": 2.0}}, "one text per column"),
        ({"a": {"to": "depth_m", "factor": "__import__('os')"}}, "one text per column"),
        ({"a": {"to": "depth_m", "factor": float("inf")}}, "one text per column"),
        ({"*": "depth_m"}, "can only be ''"),
        (5, "A mapping needs a dict .*, or the path of a TOML file, got 5"),
        ([("Hdg", "heading_deg")], "A mapping needs a dict"),
    ],
)
def test_a_mapping_does_nothing_else(mapping, words):
    with pytest.raises(ValueError, match=words):
        load_mapping(mapping)


def test_a_column_is_found_below_a_namespace_and_with_a_slash_in_front():
    content = log(topic("bluerov2/mavros/rc/out", ["channels[0]", "channels[1]"]))
    for name in ("/mavros/rc/out.channels[0]", "mavros/rc/out.channels[0]", "bluerov2/mavros/rc/out.channels[0]"):
        found, _ = sources(content, load_mapping({name: "t1_us", "*": ""}))
        assert [source.column for source in found] == ["bluerov2/mavros/rc/out.channels[0]"]


def test_a_name_below_two_namespaces_is_refused():
    content = log(topic("one/imu", ["x"]), topic("two/imu", ["x"]))
    with pytest.raises(ValueError, match=r"may be 'one/imu\.x', 'two/imu\.x': write one of them"):
        sources(content, load_mapping({"imu.x": "p_radps"}))


def test_what_no_mapping_names_is_listed_in_a_line():
    found, notes = sources(log(table({"vacuum": "inHg"}, depth_m=[1], vacuum=[7], gain=[1])), load_mapping(None))
    assert [source.column for source in found] == ["depth_m"]
    assert notes[0] == "vacuum: left out, since its unit 'inHg' is not known."
    assert notes[1].startswith("gain: left out, since its unit is not known")
    _, notes = sources(log(topic("status", ["a", "b", "c", "d", "e"])), load_mapping(None))
    assert notes == ["status: 5 columns (a, b, c, d, ...) left out, since no mapping names them."]


def test_names_in_brackets_or_capitals_say_their_unit():
    found, notes = sources(
        log(table({"Heading [deg]": "deg", "Pitch Angle (deg)": "deg"}, **{"Heading [deg]": [1], "DEPTH_m": [2]})),
        load_mapping(None),
    )
    assert {source.column: source.channel.name for source in found} == {
        "Heading [deg]": "heading_rad",
        "DEPTH_m": "depth_m",
    }
    assert notes == []


def test_a_field_that_is_called_as_a_channel_needs_no_mapping():
    content = log(
        Group("cmd/rudder_rad", {"cmd/rudder_rad": np.arange(3.0)}, time=np.arange(3.0)),
        topic("state", ["yaw_deg", "depth_m", "gain"]),
    )
    found, notes = sources(content, load_mapping(None))
    assert {s.column: (s.channel.name, s.by) for s in found} == {
        "cmd/rudder_rad": ("rudder_rad", FIELD),
        "state.depth_m": ("depth_m", FIELD),
        "state.yaw_deg": ("heading_rad", FIELD),
    }
    assert notes == ["state: 1 column (gain) left out, since no mapping names it."]


def test_of_two_fields_with_one_name_none_is_taken():
    found, notes = sources(log(topic("one", ["depth_m"]), topic("two", ["depth_m", "heading_deg"])), load_mapping(None))
    assert [s.column for s in found] == ["two.heading_deg"]
    assert notes[0] == "one: 1 column (depth_m) left out, since no mapping names it."


@pytest.mark.parametrize("name", ["cmd", "nav/target", "autopilot.setpoint"])
def test_a_set_point_is_not_what_was_measured(name):
    found, _ = sources(log(topic(name, ["depth_m", "rudder_deg", "heading_cmd_deg"])), load_mapping(None))
    assert [s.channel.name for s in found] == ["rudder_rad", "heading_cmd_rad"]


def test_a_mapping_that_fits_comes_before_the_name_of_a_field():
    content = log(topic("odometry", ODOMETRY, type="nav_msgs/msg/Odometry"), topic("raw", ["depth_m"]))
    found, _ = sources(content, load_mapping(None))
    depths = [s for s in found if s.channel.name == "depth_m"]
    assert [s.column for s in depths] == ["odometry.pose.pose.position.z", "raw.depth_m"]


def test_every_shipped_mapping_is_sound():
    assert shipped()
    for names in shipped():
        assert names.title
        assert names.needs or names.types
        for target in [*names.targets.values(), *(t for kind in names.types.values() for t in kind.values())]:
            channel, values = target.channel_and_values(np.array([1.0]))
            assert channel.name
            assert np.isfinite(values).all()


def test_slocum_sensors_are_known_in_a_table_with_units_behind_their_names():
    plain = log(table(m_present_time=[0, 1], m_heading=[0, 1], m_fin=[0, 0], c_fin=[0, 0], m_depth=[1, 2]))
    suffixed = log(table(m_present_time_s=[0, 1], m_heading_deg=[0, 1], m_fin_rad=[0, 0], m_depth_m=[1, 2]))
    for content in (plain, suffixed):
        found = {s.channel.name: s for s in sources(content, load_mapping(None))[0]}
        assert {"heading_rad", "rudder_rad", "depth_m", "time_s"} <= set(found)
    heading = found["heading_rad"]
    values = heading.target.channel_and_values(heading.group.columns[heading.column], heading.unit)[1]
    assert values == pytest.approx(np.radians([0, 1]))  # the unit behind the name wins over the mapping's
    assert fitting_mappings(plain)[0].glides


def test_messages_are_known_by_their_type_and_frame():
    fields = ["orientation.w", "orientation.x", "orientation.y", "orientation.z", "angular_velocity.y"]
    imu = topic("robot/imu", fields, "sensor_msgs/msg/Imu", "base_link")
    found = {s.channel.name: s.target for s in sources(log(imu), load_mapping(None))[0]}
    assert {"quaternion_enu_flu_w", "q_radps"} <= set(found)
    assert found["q_radps"].factor == -1.0
    turned = topic("robot/imu", fields, "sensor_msgs/msg/Imu", "base_link_frd")
    found = {s.channel.name: s.target for s in sources(log(turned), load_mapping(None))[0]}
    assert {"quaternion_w", "q_radps"} <= set(found)
    assert found["q_radps"].factor == 1.0


def test_of_two_topics_of_a_type_the_one_with_more_samples_is_taken():
    few = topic("a/imu", ["angular_velocity.x"], "sensor_msgs/msg/Imu", rows=3)
    many = topic("b/imu", ["angular_velocity.x"], "sensor_msgs/msg/Imu", rows=9)
    found, notes = sources(log(few, many), load_mapping(None))
    assert [source.group.name for source in found] == ["b/imu"]
    assert any(line.startswith("a/imu: 1 column") for line in notes)


def test_a_mapping_of_ours_wins_over_a_shipped_one():
    content = log(table(m_present_time=[0, 1], m_heading=[0, 1], m_depth=[1, 2]))
    found, _ = sources(content, load_mapping({"m_heading": "course_deg"}))
    assert taken(found)["m_heading"] == ("course_deg", 1.0, YOURS)


def test_a_column_that_is_named_twice_is_said_with_both_lines(tmp_path):
    path = tmp_path / "names.toml"
    path.write_text('# mine\n"vbd ok" = "vbd_ok"\nHdg = "heading_deg"\n"vbd ok" = "buoyancy_volume_m3"\n')
    with pytest.raises(ValueError, match=r"names 'vbd ok' twice, in lines 2 and 4: keep one of them\."):
        load_mapping(path)
