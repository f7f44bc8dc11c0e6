"""The study of vehicles that hover: what a step and a lost thruster come to, and the rows of its tables."""

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from controllers.autopilots import autopilot
from scripts.studies.harness import Found
from scripts.studies.hovering import LAWS, STEPS, STUDY, _held, _step


def test_a_step_settles_and_a_place_is_held(monkeypatch):
    monkeypatch.setattr("scripts.studies.hovering.SETTLED", 30.0)
    plant = load_vehicle("bluerov2_heavy")
    pilot = autopilot(plant)
    settled, over, stays = _step(plant, pilot, "depth_m")
    assert 1.0 < settled < 5.0
    assert over < 1.0
    assert stays < 1e-3
    lost = replace_at(plant, {"effects.t1.lost": 1.0, "effects.current.north": 0.3})
    unknown, known = _held(lost, pilot), _held(lost, autopilot(plant, lost={"t1": 1.0}))
    assert unknown["turned"] > 5.0 * known["turned"]
    assert known["last"] < 1e-3


def test_rows_have_what_was_found():
    steps = {f"{law} {name}": [2.0 + k, 0.5, 0.0] for k, law in enumerate(LAWS) for name in STEPS}
    held = {"current, pid": {"largest": 0.12, "last": 1e-6, "turned": 0.1, "tilted": 0.2, "tilt": 0.0}}
    found = Found({"bluerov": {0: {"steps": steps, "held": held}}}, {})
    of_steps, of_places = STUDY.sheets(found)
    assert of_steps.rows[0] == ["bluerov", "north_m", "2", "2.0", "0.5", "3.0", "0.5"]
    assert of_places.rows == [["bluerov", "current, pid", "0.120", "1e-06", "5.7", "11.5", "0.0"]]
