"""Random accelerations and errors of readings that last: which of them act alike."""

import numpy as np
import pytest

from auv_gym.physics.pushes import fade, shove, ways_of

# a steady push of state 2, one of state 4, a swell that pushes state 2 and its partner, an error of output 1
KICKS = np.array([[2, 0.4, 0.6, 0.0], [4, 0.5, 0.5, 0.0], [2, 0.4, 0.6, 1.3], [2, 0.0, 0.0, 0.0], [-2, 0.0, 0.0, 0.0]])


def test_noises_that_push_alike_are_one_way():
    first, ways = ways_of(KICKS)
    assert first.tolist() == [0, 1]
    assert ways.tolist() == [0, 1, 0, -1, -1]
    first, ways = ways_of(np.zeros((0, 4)))
    assert (first.size, ways.size) == (0, 0)


@pytest.mark.parametrize("side", [1, 2])
def test_what_is_of_one_way_does_the_same_and_what_has_none_does_nothing(side):
    ways = ways_of(KICKS)[1]
    moved = []
    for d in range(len(KICKS)):
        x = np.zeros(6)
        shove(x, np.eye(len(KICKS))[d], KICKS, side, 0.5)
        moved.append(x)
    for d, way in enumerate(ways):
        assert np.array_equal(moved[d], moved[int(np.argmax(ways == way))] if way >= 0 else np.zeros(6))


def test_a_swell_turns_into_its_partner():
    push = np.array([0.0, 0.0, 1.0, 0.0, 0.0])
    fade(push, np.full(5, 0.9), KICKS, 0.5)
    assert push[2:4] == pytest.approx([0.9 * np.cos(0.65), 0.9 * np.sin(0.65)])
