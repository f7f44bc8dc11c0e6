import os
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers import vector as wrappers

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.envs.tasks import TASKS
from auv_gym.envs.vector_env import TaskVectorEnv
from auv_gym.models.linear import StateSpace
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle

BODY = [name for name, task in TASKS.items() if task.vehicle == "remus100"]
ROOT = str(Path(__file__).parents[2])
# Everything that is drawn: noisy, late, coarse and missing readings, dead times, parameters of vehicle and water.
DRAWN = {
    "effects": {
        "effects.sampling.gyros.noise": 0.01,
        "effects.sampling.depth.dropout": 0.2,
        "effects.sampling.depth.delay": 0.3,
        "effects.sampling.compass.quantisation": 0.02,
        "effects.waves.amplitude_cos": 0.2,
        "effects.rudder.dead_time": 0.25,
    },
    "randomise": {
        "effects.current.north": (-0.3, 0.3),
        "effects.stern_plane.dead_time": (0.0, 0.5),
        "effects.sampling.depth.noise": (0.0, 0.1),
        "hull.surge.u_u": (-2.0, -1.5),
    },
}
FLOAT_DRAWN = {
    "effects": {
        "effects.sampling.depth.dropout": 0.2,
        "effects.sampling.depth.delay": 1.0,
        "effects.sampling.depth.quantisation": 0.02,
        "effects.water.heave_cos": 0.05,
        "effects.piston.dead_time": 1.7,
    },
    "randomise": {
        "effects.volume.offset": (-1e-5, 1e-5),
        "effects.piston.lag": (0.0, 3.0),
        "effects.sampling.depth.noise": (0.0, 0.3),
        "hull.piston_neutral": (0.52, 0.58),
    },
}
GLIDER_DRAWN = {
    "effects": {
        "effects.sampling.compass.dropout": 0.2,
        "effects.sampling.compass.delay": 8.0,
        "effects.rudder.dead_time": 6.0,
        "effects.compass.lag": 2.0,
    },
    "randomise": {"effects.yaw.moment": (-0.01, 0.01), "effects.sampling.compass.noise": (0.0, 0.05)},
}
LINEAR = StateSpace(
    np.array([[0.9, 0.0], [1.0, 1.0]]), np.array([[0.02], [0.0]]), np.eye(2)[1:], ("rudder_rad",), ("heading_rad",), 4.0
)
WILD = replace(LINEAR, a=np.array([[9.0, 0.0], [1.0, 9.0]]))
CASES = {
    **{task: (task, {"duration": 4.0, **DRAWN}) for task in BODY},
    "float": ("FloatDepth", {"duration": 28.0, **FLOAT_DRAWN}),
    "float at two rates": ("FloatDepth", {"duration": 14.0, "near": (5.0, 0.36), "target": 30.0, **FLOAT_DRAWN}),
    "float with oil": ("FloatDepth", {"duration": 1200.0, "vehicle": "mermaid"}),
    "glider": ("GliderHeading", {"duration": 100.0, "speed": (0.2, 0.4), **GLIDER_DRAWN}),
    "glider by a model": ("GliderHeading", {"duration": 100.0, "compass_noise": 0.02, "model": LINEAR}),
    "glider by a model that diverges": ("GliderHeading", {"duration": 100.0, "model": WILD}),
}


def make(task="Depth", num_envs=3, **options):
    return gymnasium.make_vec(f"auv_gym/{task}-v0", num_envs=num_envs, **options)


def actions_for(envs, steps, seed=0):
    draws = np.random.default_rng(seed)
    return draws.uniform(-1.2, 1.2, (steps, *envs.action_space.shape)).astype(np.float32)


def assert_same_info(one, other, i):
    """The i-th of a sync environment's infos, objects for what is a mapping, and the native ones, dicts of arrays."""
    assert one.keys() == other.keys()
    for name, values in one.items():
        if not name.startswith("_") and one[f"_{name}"][i]:
            own = {n: v[i] for n, v in other[name].items() if n[0] != "_"} if isinstance(other[name], dict) else None
            expected = (
                values[i] if isinstance(values, np.ndarray) else {n: v[i] for n, v in values.items() if n[0] != "_"}
            )
            assert expected == (other[name][i] if own is None else own), name


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("case", list(CASES))
def test_it_is_bit_for_bit_the_single_environments(case, mode):
    task, options = CASES[case]
    sync = make(task, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **options)
    native = make(task, autoreset_mode=mode, **options)
    one, other = sync.reset(seed=7), native.reset(seed=7)
    np.testing.assert_array_equal(one[0], other[0])
    ends, steps = 0, 400
    for k, actions in enumerate(actions_for(native, steps)):
        one, other = sync.step(actions), native.step(actions)
        for expected, found in zip(one[:4], other[:4], strict=True):
            np.testing.assert_array_equal(expected, found)
            assert expected.dtype == found.dtype
        ends += int((one[2] | one[3]).sum())
        if mode == "SameStep":
            finals = [
                (a, b) for a, b in zip(one[4].pop("final_obs", []), other[4].pop("final_obs", [])) if a is not None
            ]
            assert all(np.array_equal(a, b) for a, b in finals)
            for infos in (one[4], other[4]):
                infos.pop("_final_obs", None), infos.pop("final_info", None), infos.pop("_final_info", None)
        if k % 10 == 0 and "randomised" not in one[4]:
            for i in range(3):
                assert_same_info(one[4], other[4], i)
    assert ends > 3 * steps / 45  # an episode has at most 40 steps


def test_disabled_autoreset_waits_for_a_reset():
    envs = make(autoreset_mode="Disabled", duration=0.5)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    envs.reset(seed=0)
    other = np.zeros((3, 1), np.float32)
    for _ in range(5):
        *_, truncated, infos = envs.step(other)
    assert truncated.all()
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset_mask"):
        envs.step(other)
    mask = np.array([True, False, True])
    _, infos = envs.reset(options={"reset_mask": mask})
    assert infos["time_s"].tolist() == [0.0, 0.5, 0.0]
    with pytest.raises(gymnasium.error.ResetNeeded, match="1 environments have ended"):
        envs.step(other)
    envs.reset(options={"reset_mask": ~mask})
    assert envs.step(other)[-1]["time_s"] == pytest.approx(0.1)


def test_the_default_mode_is_that_of_gymnasium():
    assert make().metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert TaskVectorEnv.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP


def test_seeds_are_taken_one_by_one_or_counted_up():
    envs = make(num_envs=4)
    counted, _ = envs.reset(seed=10)
    listed, _ = envs.reset(seed=[10, 11, 12, 13])
    np.testing.assert_array_equal(counted, listed)
    assert envs.np_random_seed == (10, 11, 12, 13)
    on, _ = envs.reset()
    assert not np.array_equal(on, listed)
    unseeded, _ = make(num_envs=4).reset()
    assert len(np.unique(unseeded[:, 0])) == 4
    with pytest.raises(ValueError, match="one for each of 4"):
        envs.reset(seed=[1, 2])


def test_a_terminated_environment_says_why():
    envs = make(num_envs=2)
    envs.reset(seed=0, options={"start": {"depth_m": 0.05, "pitch_rad": 0.5}})
    terminated = np.zeros(2, dtype=bool)
    while not terminated.any():
        _, rewards, terminated, truncated, infos = envs.step(np.zeros((2, 1), np.float32))
    assert terminated.all()
    assert not truncated.any()
    assert all(reason.startswith("broached") for reason in infos["reason"])
    assert (rewards < -500.0).all()


def test_arrays_of_a_step_are_not_written_to_later():
    envs = make()
    first, _ = envs.reset(seed=0)
    kept = first.copy()
    one = envs.step(np.full((3, 1), 0.5, np.float32))
    copies = [array.copy() for array in one[:4]], one[4]["state"]["depth_m"].copy()
    for _ in range(5):
        envs.step(np.full((3, 1), -0.5, np.float32))
    np.testing.assert_array_equal(first, kept)
    for array, before in zip(one[:4], copies[0], strict=True):
        np.testing.assert_array_equal(array, before)
    np.testing.assert_array_equal(one[4]["state"]["depth_m"], copies[1])


def test_an_own_action_for_each_environment():
    envs = make("Heading", num_envs=2)
    envs.reset(seed=0, options={"start": {"heading_rad": 0.0}})
    for _ in range(30):
        *_, infos = envs.step(np.array([[0.5], [-0.5]], np.float32))
    assert infos["command"]["rudder_rad"].tolist() == [0.5 * 0.3490658503988659, -0.5 * 0.3490658503988659]
    port, starboard = infos["state"]["heading_rad"]
    assert port * starboard < 0.0


def test_wrappers_of_gymnasium_work_on_it():
    envs = wrappers.RecordEpisodeStatistics(make(duration=1.0))
    envs = wrappers.DictInfoToList(envs)
    envs.reset(seed=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = [envs.step(actions) for actions in actions_for(envs, 25)]
    ended = [infos for *_, infos in found if "episode" in infos[0]]
    assert len(ended) == 2
    assert all(info["episode"]["l"] == 10 for infos in ended for info in infos)
    assert found[-1][-1][1]["state"].keys() == set(load_vehicle("remus100").states)
    normal = wrappers.NormalizeObservation(make(duration=1.0))
    observations, _ = normal.reset(seed=0)
    assert observations.shape == (3, 6)


def test_a_plant_of_another_make_drives_it():
    drifting = replace_at(load_vehicle("remus100"), "effects.current.east", 0.3)
    by_model, plain = make(model=drifting), make()
    one, other = by_model.reset(seed=0), plain.reset(seed=0)
    np.testing.assert_array_equal(one[0], other[0])
    actions = actions_for(plain, 5)
    for a in actions:
        one, other = by_model.step(a), plain.step(a)
    assert not np.array_equal(one[-1]["state"]["east_m"], other[-1]["state"]["east_m"])


@pytest.mark.parametrize(
    "options, message",
    [
        ({"num_envs": 0}, "num_envs needs a whole number"),
        ({"num_envs": 2.5}, "num_envs needs a whole number"),
        ({"render_mode": "rgb_array"}, "draws nothing"),
        ({"autoreset_mode": "Sometimes"}, "Sometimes"),
        ({"duration": -1.0}, "duration needs"),
    ],
)
def test_what_does_not_fit_is_refused(options, message):
    with pytest.raises(ValueError, match=message):
        TaskVectorEnv("Depth", **options)


def test_bad_actions_and_masks_are_refused():
    envs = make()
    with pytest.raises(gymnasium.error.ResetNeeded, match="3 environments have not begun"):
        envs.step(np.zeros((3, 1), np.float32))
    envs.reset(seed=0)
    for bad in (np.zeros((3, 2)), np.zeros(3), np.full((3, 1), np.nan)):
        with pytest.raises(ValueError, match="finite numbers"):
            envs.step(bad)
    for mask in (np.zeros(3, dtype=bool), np.ones(2, dtype=bool), [True, True, True]):
        with pytest.raises(ValueError, match="reset_mask"):
            envs.reset(options={"reset_mask": mask})
    with pytest.raises(ValueError, match="reset has the options"):
        envs.reset(options={"headng": 1.0})


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_a_forked_process_is_told_to_be_spawned(tmp_path):
    code = (
        "import os, sys, gymnasium, auv_gym.envs, numpy as np\n"
        "envs = gymnasium.make_vec('auv_gym/Depth-v0', num_envs=2)\n"
        "envs.reset(seed=0)\n"
        "child = os.fork()\n"
        "if child == 0:\n"
        "    try:\n"
        "        envs.step(np.zeros((2, 1), np.float32))\n"
        "    except RuntimeError as error:\n"
        "        print(error)\n"
        "    sys.stdout.flush(), os._exit(0)\n"
        "os.waitpid(child, 0)\n"
        "print(envs.step(np.zeros((2, 1), np.float32))[2])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=dict(os.environ, PYTHONPATH=ROOT)
    )
    assert done.returncode == 0, done.stderr
    said, stepped = done.stdout.strip().splitlines()
    assert "start it by spawning" in said
    assert stepped == "[False False]"
