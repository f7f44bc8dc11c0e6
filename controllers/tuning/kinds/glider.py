"""Trials and initial gains of a glider's heading loop, by pole placement."""

from __future__ import annotations

from auv_gym.plant import Plant
from controllers.gains import Loops
from controllers.pid import heading_pid
from controllers.trials.trial import Steps, at_rest
from controllers.tuning.kinds import OFF, SEGMENT, Moved, Trial, TuningKind


def _trial(plant: Plant) -> Trial:
    scale = max(3.0 * plant.dt, 10.0)
    duration = 2.0 * SEGMENT * scale
    steps: Steps = {"heading_rad": [(0.0, 0.9), (0.5 * duration, 0.4)]}
    held = {"heading_rad": 0.0}
    return Trial(steps, held, duration, scale, lambda plant: at_rest(plant, held))


def _first(plant: Plant, of_law: str) -> Loops:
    pid, names = heading_pid(plant), ("proportional", "integral", "derivative", "filter_time", "integral_range")
    return {"heading": {name: getattr(pid, name) for name in names}}


KIND = TuningKind(
    trial=_trial,
    first=_first,
    loops=lambda plant, of_law: {"heading_rad": ("heading",)},
    moved_by=lambda plant, name: Moved("rudder_rad", 2.0 * plant.hull.rudder_limit),
    offsets=lambda plant: {"effects.rudder.offset": OFF * plant.hull.rudder_limit},
)
