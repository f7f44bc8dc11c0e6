"""Runs in a chart are the same runs, corrected where attitudes are small turns, compiled or not."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from auv_gym.plant import Chart, Correction, Plant, Runs
from auv_gym.records.attitude import ANGLES
from auv_gym.records.record import Record
from tests.identification.tumbler import RATES, flown, tumbler
from tests.plain_python import run_plain

PLANT = tumbler()
AT = PLANT.family.states.index("roll_rad")
HELD = slice(AT, AT + 3)


@pytest.fixture(scope="module")
def tumbled() -> Record:
    """A log without noise of a vehicle that passes the vertical."""
    log = flown(PLANT, 1, seconds=20.0, noise=0.0)
    steep = np.abs(log["pitch_rad"]) > 1.3
    assert np.sum(np.diff(steep.astype(int)) == 1) > 3
    return log


def rotations(angles: np.ndarray) -> Rotation:
    return Rotation.from_euler("ZYX", angles[:, ::-1])


def apart(one: np.ndarray, other: np.ndarray) -> float:
    """The largest angle between attitudes given as roll, pitch and heading, (n, 3)."""
    return float((rotations(one).inv() * rotations(other)).magnitude().max())


def test_a_free_run_in_a_chart_is_the_free_run(tumbled):
    start = np.zeros((1, len(PLANT.family.states)))
    start[0, AT : AT + 3] = 0.4, 1.5, -2.0
    windows = [slice(30, 90), slice(120, 200)]
    starts = np.repeat(start, 2, axis=0)
    chart = Chart.along(PLANT.family, tumbled)
    assert chart.on
    rows = np.r_[30:90, 120:200]
    seen = chart.seen(starts, [w.start for w in windows])
    runs = Runs.over(PLANT, tumbled, windows, chart)
    y = PLANT.run_many(runs, PLANT.vector[None], seen[None])[0]
    plain = PLANT.run(tumbled, windows, starts)
    # rounding of 1e-16 at each row, which a vehicle that tumbles for 8 s makes larger by some hundred
    assert y[:, 3:] == pytest.approx(plain[:, 3:], abs=1e-11)
    assert apart(kept(chart, level_axes(chart, rows).inv().apply(y[:, :3]), rows), plain[:, :3]) < 1e-11
    assert chart.kept(seen, [30, 120])[:, HELD] == pytest.approx(starts[:, HELD], abs=1e-12)


def level_axes(chart: Chart, rows: np.ndarray) -> Rotation:
    """From the body axes of the references of rows to the level axes and the vertical, in which outputs are."""
    seen = Rotation.from_quat(chart.references[rows], scalar_first=True)
    ahead = seen.apply([1.0, 0.0, 0.0])
    return Rotation.from_euler("z", np.arctan2(ahead[:, 1:2], ahead[:, :1])).inv() * seen


def kept(chart: Chart, turned: np.ndarray, rows: np.ndarray) -> np.ndarray:
    states = np.zeros((len(rows), len(PLANT.family.states)))
    states[:, HELD] = turned
    return chart.kept(states, rows)[:, HELD]


def corrected(plant: Plant, record: Record) -> tuple[np.ndarray, np.ndarray]:
    """Predictions of a run whose attitude is put to the measured one at each row, and the states one row later."""
    chart, size = Chart.along(plant.family, record), len(plant.family.states) + len(plant.family.sensors)
    windows = record.segments
    runs, rows = Runs.over(plant, record, windows, chart), len(record)
    measured = np.full((rows, len(plant.outputs)), np.nan)
    told = np.array([plant.outputs.index(name) for name in ANGLES])
    measured[:, told] = 0.0
    back = np.ascontiguousarray(level_axes(chart, np.arange(rows)).inv().as_matrix())
    held = {"gains": back, "moved": np.arange(size)[HELD], "told": told}
    free = Correction.none(plant, runs)
    correction = replace(free, measured=measured, decays=np.empty((rows, 0)), **held)
    starts = np.zeros((1, 1, size))
    starts[0, 0, HELD] = 0.05, -0.02, 0.03
    y, after = plant.follow_many(runs, plant.vector[None], starts, correction, True)
    return y[0], after[0]


def test_a_run_is_corrected_by_turns_and_goes_on_in_the_chart_of_the_next_row(tumbled):
    rng = np.random.default_rng(0)
    read = rotations(tumbled.matrix(ANGLES)) * Rotation.from_rotvec(0.02 * rng.standard_normal((len(tumbled), 3)))
    log = tumbled.with_channels(dict(zip(ANGLES, read.as_euler("ZYX")[:, ::-1].T, strict=True)))
    y, after = corrected(PLANT, log)
    # step by step, from the measured attitude at each row
    x, chart = PLANT.initial(np.zeros(len(PLANT.outputs))), Chart.along(PLANT.family, log)
    size = len(PLANT.family.states)
    level = level_axes(chart, np.arange(len(log)))
    inputs = np.column_stack([log[n] if log.has(n) else np.full(len(log), PLANT.constants[n]) for n in PLANT.inputs])
    for k in range(len(log) - 1):
        x[HELD] = log.matrix(ANGLES)[k]
        x = PLANT.step(x, inputs[k])
        turned = chart.seen(x[None, :size], [k + 1])[0, HELD]
        assert y[k + 1, :3] == pytest.approx(level[k + 1].apply(turned), abs=1e-11)
        assert after[k, HELD] == pytest.approx(turned, abs=1e-11)
    assert y[0, :3] == pytest.approx(level[0].apply([0.05, -0.02, 0.03]), abs=1e-14)


def test_a_push_of_an_attitude_is_a_turn_about_its_axes(tumbled):
    chart, size = Chart.along(PLANT.family, tumbled), len(PLANT.family.states) + len(PLANT.family.sensors)
    runs = Runs.over(PLANT, tumbled, tumbled.segments, chart)
    kicks = np.array([[AT + 2.0, 0.0, 1.0, 0.0]])
    free = Correction.none(PLANT, runs)
    correction = replace(free, kicks=kicks, decays=np.ones((len(tumbled), 1)))
    starts = np.zeros((2, 1, size + 1))
    starts[1, 0, size] = 0.03  # rad/s
    _, after = PLANT.follow_many(runs, np.repeat(PLANT.vector[None], 2, axis=0), starts, correction, True)
    still, pushed = (kept(chart, a[:1, HELD], np.array([1])) for a in after)
    expected = rotations(pushed) * (rotations(still).inv())
    assert expected.magnitude() == pytest.approx(0.03 * PLANT.dt, rel=1e-2)  # a sum of vectors that are small turns


def test_it_is_on_where_all_attitude_was_measured_and_turns_far(tumbled):
    family, rows = PLANT.family, np.arange(len(tumbled))
    level = tumbled.with_channels({"pitch_rad": 0.9 * np.sin(rows), "roll_rad": 0.5 * np.cos(rows)})
    assert not Chart.along(family, level).on
    assert Chart.along(family, level, far=True).on
    assert Chart.along(family, level.with_channels({"pitch_rad": 1.1 * np.sin(rows)})).on
    jumping = level.with_channels({"roll_rad": np.where(rows > 50, np.pi, 0.0)})
    assert Chart.along(family, jumping).on
    for name in ANGLES:
        assert not Chart.along(family, tumbled.without([name])).on
    assert Chart.along(family, tumbled.without(RATES)).on


def test_between_readings_references_follow_the_shortest_turn(tumbled):
    turning = np.linspace(0.0, 2.0, 41)  # about the starboard axis, through the vertical
    angles = Rotation.from_rotvec(np.outer(turning, [0.0, 1.0, 0.0])).as_euler("ZYX")[:, ::-1]
    fine = Record.from_arrays(0.1 * np.arange(41), dict(zip(ANGLES, angles.T, strict=True)))
    coarse = fine.with_channels({n: np.interp(np.arange(41), np.arange(0, 41, 4), fine[n][::4]) for n in ANGLES})
    chart = Chart.along(PLANT.family, coarse.with_intervals(dict.fromkeys(ANGLES, 0.4)))
    assert rotations(angles).as_matrix() == pytest.approx(
        Rotation.from_quat(chart.references, scalar_first=True).as_matrix(), abs=1e-12
    )
    assert chart.turned == pytest.approx(np.outer(turning, [0.0, 1.0, 0.0]), abs=1e-12)


@pytest.mark.slow
def test_plain_python_agrees_with_compiled_code(tmp_path, tumbled):
    out = tmp_path / "plain.npz"
    tumbled.save(tmp_path / "log.nc")
    run_plain(__file__, tmp_path / "log.nc", out)
    with np.load(out) as plain:
        for name, values in zip(("y", "after"), corrected(PLANT, tumbled), strict=True):
            # each operation is rounded at 1e-16, and a vehicle that tumbles for 20 s makes some of it larger
            assert plain[name] == pytest.approx(values, abs=1e-10), name


if __name__ == "__main__":
    y, after = corrected(PLANT, Record.load(sys.argv[1]))
    np.savez(sys.argv[2], y=y, after=after)
