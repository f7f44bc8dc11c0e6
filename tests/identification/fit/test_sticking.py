"""The sizes of stiction that are tried."""

import numpy as np
import pytest

from auv_gym.param import replace_at, spec_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.fit.changing import ChangingPlant, Course
from identification.fit.sticking import sticking_sizes

FLOAT, STICTION = load_vehicle("qiandao_float"), "effects.piston.stiction"
PROBE = spec_at(FLOAT, STICTION).probe


def record_of(commands: np.ndarray, segment=None) -> Record:
    depth = np.linspace(5.0, 20.0, len(commands))
    channels = {"piston_m": commands, "depth_m": depth}
    return Record.from_arrays(np.arange(len(commands), dtype=float), channels, segment=segment)


def walk(seed: int, count: int = 400) -> np.ndarray:
    """Piston commands that change at random, now and then."""
    rng = np.random.default_rng(seed)
    moves = np.where(rng.random(count) < 0.2, rng.normal(0.0, 2.0 * PROBE, count), 0.0)
    return 0.55 + np.clip(np.cumsum(moves), -0.04, 0.04)


def held(commands: np.ndarray, size: float) -> np.ndarray:
    """The positions of a piston that sticks, by the definition."""
    position, found = commands[0], []
    for command in commands:
        position = command if abs(command - position) >= size else position
        found.append(position)
    return np.array(found)


@pytest.mark.parametrize("seed, gain", [(0, 1.0), (1, 1.0), (2, 1.0), (3, 0.5)])
def test_some_tried_size_moves_the_piston_nearly_as_any_true_size_does(seed, gain):
    """Equally spaced sizes miss it: sizes that differ by a few per cent may have little in common."""
    commands = walk(seed)
    plant = replace_at(FLOAT, "effects.piston.gain", gain)
    sizes = PROBE * np.array(sticking_sizes(plant, record_of(commands), STICTION))
    asked = 0.55 + gain * (commands - 0.55)  # about the middle of the stroke
    tried = np.array([held(asked, size) for size in sizes])
    for true in np.random.default_rng(100 + seed).uniform(0.5, 8.0, 40) * PROBE:
        moved = held(asked, true)
        effect = np.linalg.norm(moved - asked)
        assert effect > 0.0
        assert np.linalg.norm(tried - moved, axis=1).min() < 0.5 * effect


def test_two_commanded_positions_leave_two_ways_to_move():
    commands = np.where(np.arange(200) // 20 % 2, 0.56, 0.552)
    (size,) = sticking_sizes(FLOAT, record_of(commands), STICTION)
    assert size * PROBE > 0.008  # smaller sizes change nothing


def test_no_size_is_tried_if_the_piston_is_never_moved():
    assert sticking_sizes(FLOAT, record_of(np.full(50, 0.55)), STICTION) == ()


def test_each_segment_begins_with_a_piston_at_its_command():
    commands = np.r_[np.full(50, 0.53), np.full(50, 0.57)]
    assert sticking_sizes(FLOAT, record_of(commands, np.arange(100) // 50), STICTION) == ()


def test_a_change_of_a_stiction_is_tried_at_fewer_of_the_sizes_of_the_stiction():
    record = record_of(walk(6))
    changing = ChangingPlant.of(FLOAT, {"late": [STICTION]}, {"late": Course((50,), (0.0, 1.0))})
    fewer, all_ = sticking_sizes(changing, record, f"changes.late.{STICTION}"), sticking_sizes(FLOAT, record, STICTION)
    assert len(fewer) <= 50 < len(all_)
    assert (fewer[0], fewer[-1]) == pytest.approx((all_[0], all_[-1]), rel=0.05)
