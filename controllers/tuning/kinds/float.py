"""Trials and initial gains of a float's depth loop, by pole placement."""

from __future__ import annotations

from auv_gym.plant import Plant
from auv_gym.plant.float_engine import find_engine
from controllers.gains import Loops
from controllers.trials.trial import Steps, at_rest
from controllers.tuning.kinds import OFF, SEGMENT, Moved, Trial, TuningKind, law


def _trial(plant: Plant) -> Trial:
    engine = find_engine(plant)
    length, duration = engine.speed * engine.time, SEGMENT * engine.time
    steps: Steps = {"depth_m": [(0.0, 5.0 * length), (0.5 * duration, 4.6 * length)]}
    held = {"depth_m": 4.0 * length}
    return Trial(steps, held, duration, engine.time, lambda plant: at_rest(plant, held))


def _first(plant: Plant, of_law: str) -> Loops:
    engine = find_engine(plant)
    time = max(3.0 * plant.dt, 1.5 * engine.half / engine.rate)
    reach = 1.4 * time * engine.speed
    gain = -engine.half / reach
    return {"depth": law(gain, gain / (7.0 * time), 0.45 * time * gain, filter_time=0.25 * time, integral_range=reach)}


def _moved_by(plant: Plant, name: str) -> Moved:
    engine = find_engine(plant)
    return Moved(engine.channel, 2.0 * engine.half)


def _offsets(plant: Plant) -> dict[str, float]:
    engine = find_engine(plant)
    return {"effects.volume.offset": OFF * engine.half * engine.volume}


KIND = TuningKind(
    trial=_trial,
    first=_first,
    loops=lambda plant, of_law: {"depth_m": ("depth",)},
    moved_by=_moved_by,
    offsets=_offsets,
)
