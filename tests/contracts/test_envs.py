"""What every registered environment promises, and every kind of vehicle in one."""

import copy
import pickle
import subprocess
import sys
import tracemalloc
import warnings
from dataclasses import dataclass, replace
from functools import reduce
from operator import add

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import auv_gym.envs  # noqa: F401  (registers)
from auv_gym.envs.kinds import KINDS
from auv_gym.envs.registration import ENVIRONMENTS, register_envs
from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.tasks import TASKS
from auv_gym.param import list_paths, replace_at, value_at
from auv_gym.plant import list_vehicles, load_vehicle, save_vehicle
from tests.envs.env_runs import InPython, drawn_actions, ends, run
from tests.plain_python import run_plain

every = pytest.mark.parametrize("name", list(ENVIRONMENTS))


def rollout(env, seed, steps=40):
    """Observations, rewards and infos of a run with actions drawn from a seed of their own."""
    actions = np.random.default_rng(99)
    observation, info = env.reset(seed=seed)
    observations, rewards, infos = [observation], [], [info]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(actions.uniform(-1.0, 1.0, env.action_space.shape))
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
        if terminated or truncated:
            break
    return np.array(observations), np.array(rewards), infos


@every
def test_gymnasium_finds_no_fault(name, monkeypatch):
    monkeypatch.setattr("auv_gym.rendering.Window.show", lambda window, picture: None)  # no display is needed
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(name)
        check_env(env.unwrapped)
    assert env.spec.id == name


@every
def test_same_seed_same_rollout(name):
    one, two = gymnasium.make(name), gymnasium.make(name)
    first, again, other = rollout(one, 5), rollout(two, 5), rollout(two, 6)
    np.testing.assert_array_equal(first[0], again[0])
    np.testing.assert_array_equal(first[1], again[1])
    assert first[2] == again[2]
    assert not np.array_equal(first[0], other[0])


@pytest.fixture(scope="module")
def elsewhere():
    """Five observations of every environment, as another process has them, by name."""
    code = (
        "import sys, gymnasium, auv_gym.envs, numpy as np\n"
        "for name in sys.argv[1:]:\n"
        "    env = gymnasium.make(name)\n"
        "    env.reset(seed=5)\n"
        "    draws = np.random.default_rng(1)\n"
        "    print([env.step(draws.uniform(-1, 1, env.action_space.shape))[0].tobytes().hex() for _ in range(5)])"
    )
    run = [sys.executable, "-c", code, *ENVIRONMENTS]
    lines = subprocess.run(run, capture_output=True, text=True, check=True).stdout.splitlines()
    return dict(zip(ENVIRONMENTS, lines, strict=True))


@every
def test_same_seed_same_rollout_in_another_process(name, elsewhere):
    env = gymnasium.make(name)
    env.reset(seed=5)
    draws = np.random.default_rng(1)
    here = [env.step(draws.uniform(-1, 1, env.action_space.shape))[0].tobytes().hex() for _ in range(5)]
    assert elsewhere[name] == str(here)


@every
def test_observations_stay_in_their_space(name):
    env = gymnasium.make(name)
    observations, rewards, _ = rollout(env, 1, steps=10_000)
    assert all(env.observation_space.contains(o) for o in observations)
    assert np.isfinite(rewards).all()


@every
def test_reward_is_the_sum_of_its_terms(name):
    _, rewards, infos = rollout(gymnasium.make(name), 2)
    terms = [list(info["reward_terms"].values()) for info in infos[1:]]
    assert rewards.tolist() == [reduce(add, values) for values in terms]  # from Python 3.12 on, sum() rounds once only


@every
def test_unknown_options_of_reset_are_refused(name):
    with pytest.raises(ValueError, match="reset has the options"):
        gymnasium.make(name).reset(options={"headng": 1.0})


@every
def test_registering_again_changes_nothing(name):
    before = gymnasium.registry[name]
    register_envs()
    assert gymnasium.registry[name] is before


@every
def test_vector_environments_run_it(name):
    envs = gymnasium.make_vec(name, num_envs=3, vectorization_mode="sync")
    observations, _ = envs.reset(seed=3)
    observations, rewards, *_ = envs.step(np.zeros((3, *envs.single_action_space.shape), np.float32))
    assert observations.shape == (3, *envs.single_observation_space.shape)
    assert np.isfinite(rewards).all()


@every
def test_the_native_vector_environment_is_the_single_one_many_times(name):
    envs = gymnasium.make_vec(name, num_envs=2)
    assert isinstance(envs.metadata["autoreset_mode"], gymnasium.vector.AutoresetMode)
    observations, _ = envs.reset(seed=5)
    for i in range(2):
        env = gymnasium.make(name)
        assert env.observation_space == envs.single_observation_space
        assert env.action_space == envs.single_action_space
        np.testing.assert_array_equal(observations[i], env.reset(seed=5 + i)[0])


@every
def test_it_is_truncated_after_its_duration_and_then_asks_for_a_reset(name):
    dt = gymnasium.make(name).unwrapped.plant.dt
    env = gymnasium.make(name, duration=10 * dt).unwrapped
    steps = run(env, np.zeros((10, *env.action_space.shape)))
    assert [truncated for _, _, _, truncated, _ in steps] == [False] * 9 + [True]
    assert steps[-1][-1]["time_s"] == pytest.approx(10 * dt)
    with pytest.raises(gymnasium.error.ResetNeeded, match="reset"):
        env.step(np.zeros(env.action_space.shape))


@every
def test_pictures_change_with_the_run(name):
    pytest.importorskip("matplotlib")
    env = gymnasium.make(name, render_mode="rgb_array").unwrapped
    env.reset(seed=0)
    first = env.render()
    run(env, np.full((30, *env.action_space.shape), 0.4))
    later = env.render()
    assert first.dtype == np.uint8
    assert first.shape == later.shape == (600, 960, 3)
    assert (first != later).any()
    env.close()
    assert gymnasium.make(name).unwrapped.render() is None


def test_the_registered_names_are_the_tasks():
    assert set(ENVIRONMENTS) == {f"auv_gym/{name}-v0" for name in TASKS}


# ---------------------------------------------------------------------------- every kind of vehicle, once


@dataclass(frozen=True)
class Case:
    """An environment of a kind of vehicle; noise: the sensor whose noise is drawn."""

    name: str
    effects: dict
    noise: str
    computed: tuple = ()  # readings that the environment computes itself
    vehicle: str | None = None

    def make(self, **options):
        return TaskEnv(self.name, **{"vehicle": self.vehicle, **options})

    def noisy(self, size=0.1):
        return {f"effects.sampling.{self.noise}.noise": size}


CASES = {
    "body": Case(
        "Path",
        {
            "effects.current.north": 0.2,
            "effects.rudder.dead_time": 0.25,
            "effects.compass.lag": 0.5,
        },
        "depth",
    ),
    "float": Case(
        "FloatDepth",
        {"effects.volume.compressibility": 1e-7, "effects.piston.dead_time": 1.5, "effects.depth.lag": 2.0},
        "depth",
        computed=("depth_rate_mps",),
    ),
    "hover": Case(
        "StationKeeping",
        {
            "effects.current.north": 0.1,
            "effects.t3.dead_time": 0.12,
            "effects.compass.lag": 0.5,
            "effects.t6.lost": 0.3,
        },
        "depth",
    ),
    "glider": Case(
        "GliderHeading",
        {"effects.yaw.moment": 0.004, "effects.rudder.dead_time": 5.0, "effects.compass.lag": 3.0},
        "compass",
        computed=("u_mps",),
    ),
    "glide": Case(
        "Glide",
        {
            "effects.current.north": 0.1,
            "effects.engine.dead_time": 20.0,
            "effects.steering.roll_climb": 0.05,
            "effects.polar.growth": 0.3,
        },
        "depth",
        computed=("depth_rate_mps", "north_m", "east_m", "current_north_mps", "current_east_mps"),
    ),
    "glide_body": Case(
        "Glide",
        {
            "effects.current.north": 0.05,
            "effects.ballast.dead_time": 2.0,
            "effects.battery.turn.lag": 2.0,
            "effects.wings.lost": 0.1,
            "effects.compass.lag": 3.0,
        },
        "depth",
        computed=("depth_rate_mps",),
        vehicle="seawing",
    ),
}
# the environment's programs of a glider in six degrees of freedom take as long to compile as those of all others
every_kind = pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=[pytest.mark.slow] if kind == "glide_body" else []) for kind, case in CASES.items()],
    ids=CASES,
)


def test_there_is_a_case_for_every_kind():
    assert set(CASES) == set(KINDS.names)


@every_kind
def test_the_state_is_that_of_the_plant_under_the_same_commands(case):
    env = case.make(effects=case.effects, randomise={})
    plant = env.model
    _, info = env.reset(seed=8)
    x = np.array(list(info["state"].values()))
    for action in drawn_actions(env, 50):
        _, _, _, _, info = env.step(action)
        x = plant.step(x, np.array(list(info["command"].values())))
        assert list(info["state"].values()) == x.tolist()
        measured = dict(zip(plant.outputs, plant.output(x).tolist(), strict=True))
        assert all(value == measured[name] for name, value in info["reading"].items() if name not in case.computed)
    assert info["state"].keys() == set(plant.states)
    assert info["reading"].keys() - set(case.computed)


@every_kind
def test_effects_at_neutral_change_no_bit(case):
    plant = case.make().plant
    neutral = {p: value_at(plant, p) for p in list_paths(plant) if p.startswith("effects.")}
    plain, told = (case.make(effects=e, randomise={}) for e in (None, neutral))
    actions = drawn_actions(plain, 30)
    assert [step[-1] for step in run(plain, actions)] == [step[-1] for step in run(told, actions)]


@every_kind
def test_a_plant_stepped_in_python_gives_the_compiled_run(case):
    plant = replace_at(case.make().plant, case.effects)
    one, other = case.make(model=plant), case.make(model=InPython(plant))
    actions = drawn_actions(one, 40)
    assert other.episodes.by_model
    for compiled, python in zip(run(one, actions), run(other, actions), strict=True):
        # a start from readings finds the states to rounding, and the run carries that on
        np.testing.assert_allclose(python[0], compiled[0], atol=1e-6)
        assert python[1] == pytest.approx(compiled[1], abs=1e-7)
        assert python[-1]["state"] == pytest.approx(dict(compiled[-1]["state"]), abs=1e-7)


@every_kind
def test_a_vehicle_file_as_model_runs_compiled(case, tmp_path):
    save_vehicle(replace_at(case.make().plant, case.effects), tmp_path / "other.toml")
    by_file = case.make(model=tmp_path / "other.toml")
    by_effect = case.make(effects=case.effects, randomise={})
    actions = drawn_actions(by_file, 20)
    assert not by_file.episodes.by_model
    assert [step[-1]["state"] for step in run(by_file, actions)] == [
        step[-1]["state"] for step in run(by_effect, actions)
    ]


@every_kind
@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("in_python", [False, True])
def test_a_copy_goes_on_from_where_it_is(case, again, in_python):
    """Past the block of noise, so its generators too."""
    options = {"model": InPython(case.make().plant)} if in_python else {"randomise": {}}
    env = case.make(effects=case.noisy(), **options)
    actions = drawn_actions(env, 120, size=0.1)
    run(env, actions[:40], seed=3)
    twin, done = again(env), []
    for action in actions[40:]:
        one, other = env.step(action), twin.step(action)
        assert one[0].tolist() == other[0].tolist()
        assert one[1:] == other[1:]
        done.append(one[-1]["time_s"])
    assert len(set(done)) == 80
    assert twin is not env


@every_kind
def test_a_bad_action_is_refused_and_does_no_harm(case):
    env = case.make()
    env.reset(seed=0)
    count = env.action_space.shape[0]
    for action in (np.nan, [np.inf] * count, [0.1] * (count + 1), [[0.1] * count], "up" * 3, None, [None] * count):
        with pytest.raises(ValueError, match=f"needs {count} finite number"):
            env.step(action)
    assert env.step([0.0] * count)[-1]["time_s"] == pytest.approx(env.plant.dt)


@every_kind
def test_bad_options_are_refused(case):
    delay = next(path for path in case.effects if path.endswith("dead_time"))
    for options, words in (
        ({"vehicle": "reemus"}, "No vehicle 'reemus'"),
        ({"effects": {"effects.compas.bias": 1.0}}, "No parameter"),
        ({"randomise": {delay: 0.1}}, r"needs a pair \(low, high\)"),
        ({"randomise": {delay: (0.2, 0.1)}}, "needs low <= high"),
        ({"randomise": {delay: (0.0, 1e9)}}, "needs a value from"),
        ({"duration": 0.0}, "duration needs a number above 0 in s"),
        ({"render_mode": "ansi"}, "render_mode is None, 'rgb_array' or 'human', got 'ansi'"),
        ({"durations": 5.0}, "Did you mean 'duration'"),
        ({"colour": "red"}, f"{case.name} has no option 'colour' for .* It has vehicle, effects, "),
        ({"model": case.make().plant, "effects": case.effects}, "which model= replaces"),
        ({"model": case.make().plant, "randomise": {delay: (0.0, 0.1)}}, "which model= replaces"),
        ({"model": replace(case.make().plant, dt=0.03)}, r"steps 0.03 s and the environment .* dt=0.03"),
    ):
        with pytest.raises(ValueError, match=words):
            case.make(**options)
    for options, words in (
        ({"start": {"piston_m": 1.0}}, "reset option 'start' has .*, got 'piston_m'"),
        ({"start": {case.make().episodes.start_options[0]: "deep"}}, "needs a number"),
        ({"start": 3.0}, "start as a mapping"),
        (3, "reset needs its options by name, .*, got 3"),
    ):
        with pytest.raises(ValueError, match=words):
            case.make().reset(options=options)


@every_kind
def test_infos_survive_the_next_steps(case):
    env = case.make()
    steps = run(env, drawn_actions(env, 3, size=1.0))
    states = [dict(info["state"]) for *_, info in steps]
    assert states[0] != states[1] != states[2]
    info = steps[0][-1]
    assert pickle.loads(pickle.dumps(info)) == info == copy.deepcopy(info)
    assert repr(info["target"]) == repr(dict(info["target"]))
    assert info["state"].get("nothing") is None


@every_kind
def test_memory_does_not_grow(case):
    env = case.make(duration=50 * case.make().plant.dt, effects=case.noisy())
    actions = drawn_actions(env, 1000)
    env.reset(seed=0)
    ends(env, actions)
    tracemalloc.start()
    ends(env, actions)
    before, _ = tracemalloc.get_traced_memory()
    for _ in range(10):
        ends(env, actions)
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert after - before < 10_000  # bytes: less than one for each step


@pytest.mark.parametrize("vehicle", sorted(list_vehicles()))
def test_random_steps_of_a_preset_stay_finite(vehicle):
    plant = load_vehicle(vehicle)
    name = next(case.name for case in CASES.values() if case.make().episodes.kind is KINDS.of(plant.family))
    env = TaskEnv(name, plant, duration=200 * plant.dt)
    env.reset(seed=5)
    reasons, whole = ends(env, drawn_actions(env, 8000, seed=5, size=1.2))
    assert len(reasons) + whole >= 40
    assert not [reason for reason in reasons if "diverged" in reason]


PLAIN = """
import sys
import numpy as np
from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.vector_env import TaskVectorEnv

found = []
for task, options in (
    ("Path", {"effects": {"effects.sampling.gyros.noise": 0.01, "effects.rudder.dead_time": 0.15}}),
    ("Depth", {"randomise": {"effects.current.north": (-0.3, 0.3)}}),
    ("FloatDepth", {"near": (3.0, 0.36), "effects": {"effects.sampling.depth.noise": 0.02}}),
    ("FloatDepth", {"vehicle": "mermaid"}),
    ("Pose", {"effects": {"effects.t3.lost": 0.5, "effects.sampling.compass.noise": 0.02}}),
    ("Glide", {"effects": {"effects.volume.offset": 2e-5, "effects.sampling.depth.noise": 0.2}}),
    ("Glide", {"vehicle": "seawing", "effects": {"effects.sampling.depth.noise": 0.2}}),
    ("GliderHeading", {"compass_noise": 0.02, "randomise": {"effects.yaw.moment": (-0.01, 0.01)}}),
):
    env = TaskEnv(task, **options)
    env.reset(seed=3)
    many = TaskVectorEnv(task, 2, **options)
    many.reset(seed=3)
    for action in np.random.default_rng(1).uniform(-0.5, 0.5, (4, *env.action_space.shape)):
        observation, reward, _, _, info = env.step(action)
        state = list(info["state"].values())
        observations, rewards, *_ = many.step(np.array([action, -action]))
        row = [*observation, reward, *state, *observations[0], *observations[1], *rewards]
        found.append([*row, *np.zeros(160 - len(row))])
np.save(sys.argv[1], np.array(found))
print("numba" in sys.modules)
"""


@pytest.mark.slow
def test_plain_python_agrees_with_compiled_code(tmp_path):
    found = {}
    for jit in ("0", "1"):
        out = tmp_path / f"run{jit}.npy"
        assert run_plain("-c", PLAIN, out, jit=jit).strip() == str(jit == "1")
        found[jit] = np.load(out)
    assert np.abs(found["0"]).max() > 1.0
    # the cruise is sought to 1e-10 by each on its own; rounding of float32 observations is 1e-7
    np.testing.assert_allclose(found["0"], found["1"], rtol=1e-6, atol=2e-7)
