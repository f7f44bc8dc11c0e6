"""Straight legs between waypoints: where a vehicle is relative to one, and where the next one leads."""

from math import asin, atan2, cos, sin, sqrt

from auv_gym.compiled import compiled


@compiled
def leg_between(north0, east0, depth0, north1, east1, depth1):
    """Course, rad, angle of descent, rad, and length, m, of the way from one point to another."""
    north, east, down = north1 - north0, east1 - east0, depth1 - depth0
    length = sqrt(north * north + east * east + down * down)
    if length <= 0.0:
        return 0.0, 0.0, 0.0
    return atan2(east, north), asin(min(max(down / length, -1.0), 1.0)), length


@compiled
def leg_axes(north, east, down, course, sink):
    """A vector along a leg, to starboard of it and below it; m or m/s."""
    ahead = cos(course) * north + sin(course) * east
    return (
        cos(sink) * ahead + sin(sink) * down,
        cos(course) * east - sin(course) * north,
        cos(sink) * down - sin(sink) * ahead,
    )


@compiled
def point_ahead(north, east, depth, course, sink, length):
    """The point, m, that lies `length` further in a direction."""
    level = length * cos(sink)
    return north + level * cos(course), east + level * sin(course), depth + length * sin(sink)
