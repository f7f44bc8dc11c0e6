"""Data sets are read back by Minari itself, from a folder of the test's own."""

import gymnasium
import numpy as np
import pytest

import auv_gym.envs  # noqa: F401  # registers the environments
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record

minari = pytest.importorskip("minari", reason="the extra `minari` is not installed")
from auv_gym.exports import dataset_of_records, dataset_of_rollouts  # noqa: E402
from auv_gym.rl.evaluation import returns  # noqa: E402
from controllers.piloting import pilot_for  # noqa: E402


@pytest.fixture(autouse=True)
def datasets(tmp_path, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


def log(**more):
    """Two segments of 30 and 20 samples of a glider's heading."""
    rng = np.random.default_rng(1)
    values = {name: rng.uniform(-0.3, 0.3, 50) for name in ("rudder_rad", "heading_rad", "r_radps")}
    return Record.from_arrays(np.r_[:30, 40:60] * 1.0, values | more, segment=[0] * 30 + [1] * 20)


def test_a_log_is_an_episode_for_each_segment():
    plant, record = load_vehicle("ganeshblue"), log()
    dataset_of_records("glider/heading-v0", record, plant)
    found = minari.load_dataset("glider/heading-v0")
    assert [len(episode) for episode in found] == [29, 19]
    for episode, rows in zip(found, record.segments):
        assert np.array_equal(episode.observations, record.matrix(["heading_rad", "r_radps"])[rows])
        assert np.array_equal(episode.actions[:, 0], record["rudder_rad"][rows][:-1])
        assert np.all(episode.actions[:, plant.inputs.index("u_mps")] == plant.hull.speed)
        assert episode.truncations[-1]
        assert not episode.terminations.any()
    assert "Observations: heading_rad, r_radps." in found.storage.metadata["description"]


def test_a_log_without_an_input_is_refused():
    with pytest.raises(ValueError, match="lacks rudder_rad"):
        dataset_of_records("glider/heading-v0", log().without(["rudder_rad"]), load_vehicle("ganeshblue"))


def test_rollouts_are_the_episodes_that_the_environment_plays():
    env = gymnasium.make("auv_gym/GliderHeading-v0", duration=60.0)
    pilot, seeds = pilot_for(env, "pid"), [3, 4]
    dataset_of_rollouts("glider/pid-v0", env, pilot, seeds)
    found = minari.load_dataset("glider/pid-v0")
    assert [episode.rewards.sum() for episode in found] == pytest.approx(returns(pilot, env, seeds))
    again = found.recover_environment()
    for episode, seed in zip(found, seeds):
        observation, _ = again.reset(seed=seed)
        assert np.array_equal(observation, episode.observations[0])
        observation, *_ = again.step(episode.actions[0])
        assert np.array_equal(observation, episode.observations[1])


@pytest.mark.parametrize(
    "name", ["glider/heading", "g/heading-v0", "a glider/heading-v0", "../heading-v0", "/heading-v0"]
)
def test_a_name_that_minari_cannot_take_is_refused_and_nothing_is_written(name, tmp_path):
    with pytest.raises(ValueError, match=r"ends in its version, such as slocum/dives-v0, got .*: use letters"):
        dataset_of_records(name, log(), load_vehicle("ganeshblue"))
    assert list(tmp_path.iterdir()) == []


def test_a_data_set_is_not_overwritten():
    plant = load_vehicle("ganeshblue")
    dataset_of_records("glider/heading-v0", log(), plant)
    with pytest.raises(
        ValueError, match=r"already a Minari data set glider/heading-v0: .*, such as glider/heading-v1,"
    ):
        dataset_of_records("glider/heading-v0", log(), plant)
    assert len(minari.load_dataset("glider/heading-v0")) == 2


def test_a_data_set_that_cannot_be_written_whole_leaves_its_name_free(monkeypatch):
    def stopped(storage, episodes):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("minari.dataset.minari_storage.MinariStorage.update_metadata", stopped)
        with pytest.raises(KeyboardInterrupt):
            dataset_of_records("glider/heading-v0", log(), load_vehicle("ganeshblue"))
    assert len(dataset_of_records("glider/heading-v0", log(), load_vehicle("ganeshblue"))) == 2
