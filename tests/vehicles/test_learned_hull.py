import pickle
from dataclasses import replace

import gymnasium
import numpy as np
import pytest

from auv_gym.compiled import compiled
from auv_gym.envs.task_env import TaskEnv
from auv_gym.envs.vector_env import TaskVectorEnv
from auv_gym.model import simulate
from auv_gym.models.files import load_model, save_model
from auv_gym.param import list_paths, replace_at, spec_at
from auv_gym.plant import Plant, load_vehicle, save_vehicle
from auv_gym.records.record import Record
from auv_gym.vehicles.body.dynamics import enter
from auv_gym.vehicles.body.learned_hull import LearnedHull

HEU = load_vehicle("heu_torpedo")
TYPICAL = np.array([0.3, 0.1, 0.1, 0.2, 0.2, 0.2])
COMMANDS = np.array([0.1, -0.05, 4.0])
derivative, view = HEU.family.hooks.derivative, HEU.family.view


@compiled
def rates(x, actuators, derived, z, dz, scratch):
    enter(x, z)
    derivative(z, actuators, actuators, view(derived), dz, scratch)


def acceleration(plant: Plant, x: np.ndarray) -> np.ndarray:
    """The first six rates, M^-1 of all forces."""
    z, dz, scratch = np.zeros(14), np.zeros(14), np.zeros(plant.family.scratch)
    rates(np.ascontiguousarray(x[:13]), COMMANDS, plant.derived, z, dz, scratch)
    return dz[:6]


def forces(plant: Plant, x: np.ndarray) -> np.ndarray:
    """All forces on a vehicle, N and N m."""
    return np.linalg.solve(np.array(view(plant.derived).computed.inverse_mass), acceleration(plant, x))


def somewhere(rng: np.random.Generator) -> np.ndarray:
    x = np.zeros(len(HEU.states))
    x[:6] = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0]) + TYPICAL * rng.uniform(-1.0, 1.0, 6)
    x[8:12] = 10.0, *rng.uniform(-0.3, 0.3, 3)
    return x


def hull(n: int = 150, kernels: int = 1, size: float = 1.0) -> LearnedHull:
    rng = np.random.default_rng(7)
    support = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0]) + TYPICAL * rng.standard_normal((n, 6))
    coefficients = size * rng.standard_normal((kernels, n, 6))
    sigma, trend = np.linspace(1.5, 3.0, kernels), 10.0 * size * rng.standard_normal((6, 6))
    return LearnedHull(support, TYPICAL, sigma, coefficients, size * np.arange(6.0), 0.8, trend)


@pytest.fixture(scope="module")
def flying() -> Plant:
    """The vehicle with a hull that drags a little more than its own, and flies."""
    silent = replace(HEU, learned=LearnedHull.silent())
    rng = np.random.default_rng(1)
    support = np.array([1.2, 0.0, 0.0, 0.0, 0.0, 0.0]) + 3.0 * TYPICAL * rng.uniform(-1.0, 1.0, (400, 6))
    x = np.zeros((400, len(HEU.states)))
    x[:, :6] = support
    target = np.array([forces(silent, one) - forces(HEU, one) for one in x])
    square = (((support[:, None] - support[None]) / TYPICAL) ** 2).sum(axis=2)
    coefficients = np.linalg.solve(np.exp(-square / 200.0) + 1e-7 * np.eye(400), target)
    return replace(
        HEU, learned=LearnedHull(support, TYPICAL, np.array([200.0**0.5]), coefficients[None], np.zeros(6), 2.0)
    )


@pytest.mark.parametrize("kernels", [1, 3])
def test_the_learned_forces_stand_in_place_of_the_hulls_and_of_nothing_else(kernels):
    learned = hull(kernels=kernels)
    silent, whole = replace(HEU, learned=LearnedHull.silent()), replace(HEU, learned=learned)
    rng = np.random.default_rng(0)
    for _ in range(5):
        x = somewhere(rng)
        found = forces(whole, x) - forces(silent, x)
        assert found == pytest.approx(-learned(x[:6])[0], rel=1e-10, abs=1e-10)


def test_what_is_left_without_a_hull_is_fins_propulsion_and_weight():
    silent = replace(HEU, learned=LearnedHull.silent())
    x = np.zeros(len(HEU.states))
    x[8:11] = 10.0, 0.2, 0.1
    assert forces(silent, x) == pytest.approx(forces(HEU, x), abs=1e-12)  # at rest a hull has no force
    x[0], x[1], x[5] = 1.2, 0.1, 0.2
    slow = x.copy()
    slow[5] = 0.0
    turning = forces(silent, x) - forces(silent, slow)
    assert not turning[2:4].any()  # no Coriolis force; what is left of the rate is the rudder's
    assert abs(turning[1]) < 0.1 * abs(forces(HEU, x)[1] - forces(HEU, slow)[1])


CHANGES = {
    "effects.hull.damping_sway": 0.3,
    "effects.hull.fouling": 0.4,
    "effects.water.density": 0.02,
    "effects.load.payload": 2.0,
    "effects.load.x_g": 0.01,
    "effects.hull.added_mass_sway": 0.2,
    "effects.discovered.yaw.vv": 5.0,
    "effects.rudder.lost": 0.4,
    "effects.propeller.lost": 0.2,
}


@pytest.mark.parametrize("path", CHANGES)
def test_an_effect_changes_a_learned_hull_by_what_it_changes_in_the_given_one(path):
    felt = []
    for given in (HEU, replace_at(load_vehicle("remus100"), "hull.coriolis_of_added_mass", 1.0)):
        learned = replace(given, learned=hull())
        x = somewhere(np.random.default_rng(3))
        changes = [forces(replace_at(plant, path, CHANGES[path]), x) - forces(plant, x) for plant in (given, learned)]
        felt.append(np.abs(changes[0]).max())
        assert changes[1] == pytest.approx(changes[0], rel=1e-9, abs=1e-9)
    assert max(felt) > 1e-3


def test_neutral_effects_leave_a_learned_hull_alone_bit_for_bit():
    learned = replace(HEU, learned=hull())
    neutral = {p: spec_at(learned, p).neutral for p in list_paths(learned) if p.startswith("effects.")}
    x = somewhere(np.random.default_rng(4))
    assert np.array_equal(acceleration(replace_at(learned, neutral), x), acceleration(learned, x))
    p = view(learned.derived).computed
    assert not np.any(p.momentum)
    assert p.cross_y == 0.0
    assert not np.any(p.ends)


def test_rollout_and_steps_are_one(flying):
    k = np.arange(40)
    record = Record.from_arrays(
        0.1 * k, {"rudder_rad": 0.1 * np.sin(k), "stern_plane_rad": 0.02 * np.sin(k), "propeller_V": 4.0 + 0.0 * k}
    )
    run = simulate(flying, record.with_channels({"u_mps": 1.2 + 0.0 * k, "depth_m": 10.0 + 0.0 * k}))
    y0 = np.array([{"u_mps": 1.2, "depth_m": 10.0}.get(name, 0.0) for name in flying.outputs])
    x, rows = flying.initial(y0), []
    for u in np.column_stack([record["rudder_rad"], record["stern_plane_rad"], record["propeller_V"]]):
        rows.append(flying.output(x))
        x = flying.step(x, u)
    found = np.column_stack([run[name] for name in flying.outputs])
    assert found == pytest.approx(np.array(rows), abs=1e-9)  # coefficients of 1e5 N cancel, and times are rounded


def test_single_and_vector_environments_are_bit_for_bit_the_same_and_say_how_far_the_data_are(flying):
    many, one = TaskVectorEnv("Depth", 3, flying), TaskEnv("Depth", flying)
    many.reset(seed=5)
    _, info = one.reset(seed=6)
    assert info["support_distance"] == pytest.approx(distance_of(flying, info), rel=1e-9)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (15, 3, *one.action_space.shape)).astype(np.float32)
    for action in actions:
        observations, *_, infos = many.step(action)
        observation, *_, info = one.step(action[1])
        assert np.array_equal(observations[1], observation)
        assert infos["support_distance"][1] == info["support_distance"]
    assert info["support_distance"] == pytest.approx(distance_of(flying, info), rel=1e-9)
    assert 0.0 < info["support_distance"] < 1.0


def distance_of(plant: Plant, info: dict) -> float:
    velocity = np.array([info["state"][name] for name in plant.family.states[:6]])
    return float(plant.learned.distance(velocity)[0])  # type: ignore[union-attr]


def test_a_given_hull_says_nothing_of_a_distance():
    _, info = TaskEnv("Depth", HEU).reset(seed=0)
    assert "support_distance" not in info


def test_it_drives_the_environment_of_its_vehicle_and_can_be_randomised(flying):
    env = TaskEnv("Depth", HEU, model=flying, effects={})
    _, info = env.reset(seed=1)
    assert env.model is not HEU
    assert "support_distance" in info
    drawn = TaskVectorEnv("Depth", 2, flying, randomise={"effects.hull.fouling": (0.0, 0.5)})
    drawn.reset(seed=[1, 2])
    speeds = []
    for _ in range(80):
        *_, infos = drawn.step(np.zeros((2, *drawn.single_action_space.shape), dtype=np.float32))
        speeds.append(infos["state"]["u_mps"])
    fouling = drawn.reset(seed=[1, 2])[1]["randomised"]["effects.hull.fouling"]
    slower = int(np.argmax(fouling))
    assert speeds[-1][slower] < speeds[-1][1 - slower]


def test_an_environment_is_pickled_with_its_hull(flying):
    env = TaskEnv("Heading", flying)
    env.reset(seed=2)
    copy = pickle.loads(pickle.dumps(env))
    action = np.full(env.action_space.shape, 0.3, dtype=np.float32)
    for _ in range(3):
        assert np.array_equal(env.step(action)[0], copy.step(action)[0])


def test_files_hold_it_bit_for_bit(tmp_path, flying):
    path = tmp_path / "hybrid.npz"
    save_model(flying, path)
    loaded = load_model(path)
    assert isinstance(loaded, Plant)
    assert np.array_equal(loaded.vector, flying.vector)
    assert (loaded.name, loaded.dt, loaded.longest_step) == (flying.name, flying.dt, flying.longest_step)
    assert load_model(path, dt=0.2).dt == 0.2
    assert isinstance(TaskEnv("Depth", HEU, model=path).model, Plant)
    with pytest.raises(ValueError, match=r"ends in \.npz"):
        save_model(flying, tmp_path / "hybrid.toml")
    with pytest.raises(ValueError, match="use save_model"):
        save_vehicle(flying, tmp_path / "hybrid.toml")
    assert list(tmp_path.iterdir()) == [path]


def test_a_run_that_leaves_the_numbers_ends_the_episode():
    wild = replace(HEU, learned=hull(size=300.0))
    env = TaskEnv("Depth", HEU, model=wild)
    env.reset(seed=0)
    for _ in range(400):
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        if terminated or truncated:
            break
    assert terminated
    assert info["reason"]
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))


def test_what_cannot_be_a_hull_is_refused():
    good = hull()
    with pytest.raises(ValueError, match=r"coefficients of shape \(1, 150, 6\)"):
        replace(good, coefficients=good.coefficients[0])
    with pytest.raises(ValueError, match="not finite"):
        replace(good, bias=np.full(6, np.nan))
    with pytest.raises(ValueError, match="reach > 0"):
        replace(good, reach=0.0)
    with pytest.raises(ValueError, match="six degrees of freedom, got 'slocum'"):
        replace(load_vehicle("slocum"), learned=good)


def test_distance_is_nothing_at_a_centre_and_grows_away_from_it():
    learned = hull(n=40)
    assert learned.distance(learned.support) == pytest.approx(0.0, abs=1e-9)
    away = learned.support[:1] + np.array([[30.0 * TYPICAL[0], 0.0, 0.0, 0.0, 0.0, 0.0]])
    assert learned.distance(away)[0] > 10.0


def test_the_share_of_a_record_outside_counts_what_was_measured():
    learned = hull(n=30)
    near = np.repeat(learned.support[:1], 4, axis=0)
    near[2:, 0] += 20.0
    near[3, 1] = np.nan
    record = Record.from_arrays(0.1 * np.arange(4.0), dict(zip(HEU.family.states[:6], near.T, strict=True)))
    assert learned.outside(record) == pytest.approx(1.0 / 3.0)
