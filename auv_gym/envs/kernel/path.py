"""Straight legs between waypoints: a vehicle's position relative to a leg, and the switch to the next leg.

Compiled parts shared by several kinds of vehicle; `PLAN`, `ROW` and `GEOMETRY` list the fields that they need.
"""

from math import asin, atan2, cos, sin, sqrt

from auv_gym.compiled import compiled, outlined
from auv_gym.envs.kernel.layout import CHANGE_DRAWS, START_DRAWS

PLAN = {
    "follows_path": 1, "leg": 2, "turn": 1, "slope": 1, "path_speed": 1, "radius": 1, "waypoints_at": 1, "waypoints": 1,
}  # fmt: skip
NORTH = EAST = 0  # placeholders in the template, which is compiled
# the leg of a path: its start, the waypoint after its end, and directions
ROW = {"origin": 3, "next": 3, "course": 1, "sink": 1, "length": 1, "next_course": 1, "next_sink": 1}
GEOMETRY = (
    "across", "below", "remaining", "course_sin", "course_cos", "sink", "next_course_sin", "next_course_cos",
    "next_sink",
)  # fmt: skip


@compiled
def leg_between(north0, east0, depth0, north1, east1, depth1):
    """Course, rad, angle of descent, rad, and length, m, from one point to another."""
    north, east, down = north1 - north0, east1 - east0, depth1 - depth0
    length = sqrt(north * north + east * east + down * down)
    if length <= 0.0:
        return 0.0, 0.0, 0.0
    return atan2(east, north), asin(min(max(down / length, -1.0), 1.0)), length


@compiled
def leg_axes(north, east, down, course, sink):
    """Components of a vector along a leg, to starboard of it and below it; m or m/s."""
    ahead = cos(course) * north + sin(course) * east
    return (
        cos(sink) * ahead + sin(sink) * down,
        cos(course) * east - sin(course) * north,
        cos(sink) * down - sin(sink) * ahead,
    )


@compiled
def point_ahead(north, east, depth, course, sink, length):
    """The point, m, at a distance `length` in a direction."""
    level = length * cos(sink)
    return north + level * cos(course), east + level * sin(course), depth + length * sin(sink)


@outlined
def lead_on(plan, t, e, row):
    """Put the waypoint after the present one, given or drawn, into e.next, and compute the leg to it."""
    count = int(t.waypoints)
    k = int(e.reached) + 1
    if count > 0:
        at = int(t.waypoints_at) + 3 * min(k, count - 1)
        e.next[0], e.next[1], e.next[2] = plan[at], plan[at + 1], plan[at + 2]
        e.next_course, e.next_sink = e.course, e.sink
        if k < count:
            e.next_course, e.next_sink, _ = leg_between(
                e.target[0], e.target[1], e.target[2], e.next[0], e.next[1], e.next[2]
            )
        return
    at = int(t.draws_at) + START_DRAWS + int(t.randomised) + CHANGE_DRAWS * (int(e.change) % int(t.changes))
    e.change += 1.0
    length = t.leg[0] + (t.leg[1] - t.leg[0]) * row[at]
    course = e.course + t.turn * (2.0 * row[at + 1] - 1.0)
    sink = t.slope * (2.0 * row[at + 2] - 1.0)
    depth = e.target[2] + length * sin(sink)
    if depth < t.target_band[0] or depth > t.target_band[1]:
        sink = -sink
    north, east, depth = point_ahead(e.target[0], e.target[1], e.target[2], course, sink, length)
    e.next[0], e.next[1] = north, east
    e.next[2] = min(max(depth, t.target_band[0]), t.target_band[1])
    e.next_course, e.next_sink, _ = leg_between(e.target[0], e.target[1], e.target[2], e.next[0], e.next[1], e.next[2])


@outlined
def begin_path(plan, north, east, depth, heading, t, e, row):
    """Set the first two legs of a path, from a position and a heading, m and rad."""
    e.origin[0], e.origin[1], e.origin[2] = north, east, depth
    e.target[0], e.target[1], e.target[2] = north, east, depth
    e.course, e.reached = heading, -1.0
    lead_on(plan, t, e, row)
    e.reached = 0.0
    for i in range(3):
        e.target[i] = e.next[i]
    e.course, e.sink, e.length = leg_between(
        e.origin[0], e.origin[1], e.origin[2], e.target[0], e.target[1], e.target[2]
    )
    lead_on(plan, t, e, row)


@compiled
def go_on(plan, at_north, at_east, at_depth, t, e, row):
    """Switch to the next leg if the waypoint is reached from a position, m; returns whether it was the last one."""
    north, east, down = at_north - e.origin[0], at_east - e.origin[1], at_depth - e.origin[2]
    along, _, _ = leg_axes(north, east, down, e.course, e.sink)
    north, east, down = e.target[0] - at_north, e.target[1] - at_east, e.target[2] - at_depth
    near = north * north + east * east + down * down < t.radius * t.radius
    if near or along >= e.length:
        e.reached += 1.0
        if t.waypoints > 0.0 and e.reached >= t.waypoints:
            return True
        for i in range(3):
            e.origin[i] = e.target[i]
            e.target[i] = e.next[i]
        e.course, e.sink, e.length = leg_between(
            e.origin[0], e.origin[1], e.origin[2], e.target[0], e.target[1], e.target[2]
        )
        lead_on(plan, t, e, row)
    return False


@compiled
def path_terms(north, east, depth, moved_north, moved_east, moved_down, t, e):
    """The reward terms for a position off the leg, m, and for the progress along it in the step."""
    _, across, below = leg_axes(north - e.origin[0], east - e.origin[1], depth - e.origin[2], e.course, e.sink)
    moved, _, _ = leg_axes(moved_north, moved_east, moved_down, e.course, e.sink)
    return (
        -t.weight[0] * min(sqrt(across * across + below * below) / t.error_scale, 1.0),
        -t.weight[2] * min(abs(t.path_speed - moved / t.dt) / t.path_speed, 1.0),
    )


@compiled
def look_along(north, east, depth, heading, e, at):
    """Put the features that `GEOMETRY` names, from index `at` on, for a position, m, and a heading, rad."""
    f = e.features
    along, across, below = leg_axes(north - e.origin[0], east - e.origin[1], depth - e.origin[2], e.course, e.sink)
    turn, next_turn = e.course - heading, e.next_course - heading
    f[at], f[at + 1], f[at + 2] = across, below, e.length - along
    f[at + 3], f[at + 4], f[at + 5] = sin(turn), cos(turn), e.sink
    f[at + 6], f[at + 7], f[at + 8] = sin(next_turn), cos(next_turn), e.next_sink


def score_from_above(x, before, t, e):
    """The horizontal reward terms of the true position off the leg, and of the progress along it."""
    north, east = x[NORTH] - before[NORTH], x[EAST] - before[EAST]
    e.term[0], e.term[2] = path_terms(x[NORTH], x[EAST], 0.0, north, east, 0.0, t, e)
