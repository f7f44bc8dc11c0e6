"""Trials and initial gains of a hovering vehicle's loops: each axis of its pose that thrusters serve."""

from __future__ import annotations

from auv_gym.plant import Plant
from controllers.allocation import AXES
from controllers.gains import Loops
from controllers.hovering.dynamics import POSE
from controllers.kinds.hover import axis_of, dynamics_of, placed_frequencies, poses_of
from controllers.trials.trial import Steps, at_rest
from controllers.tuning.kinds import Moved, Trial, TuningKind

_LENGTHS = 40.0  # 1 / frequency of the slowest loop, duration of a target
_DEEP = 20.0  # m
_STEP, _TURN, _TILT = 1.0, 0.9, 0.2  # m, rad
# of an axis's range, to excite it: thrusters have to leave their dead zones
_SHAKEN = 0.1


def _trial(plant: Plant) -> Trial:
    served = [AXES.index(name) for name in dynamics_of(plant).allocation.counts]
    scale = max(1.0 / float(placed_frequencies(plant)[served].min()), 3.0 * plant.dt)
    half = _LENGTHS * scale
    sizes = (_STEP, _STEP, _STEP, _TILT, _TILT, _TURN)
    held = {name: _DEEP if name == "depth_m" else 0.0 for name in poses_of(plant)}
    size = {name: sizes[POSE.index(name)] for name in held}
    steps: Steps = {name: [(0.0, at + size[name]), (half, at + 0.4 * size[name])] for name, at in held.items()}
    return Trial(steps, held, 2.0 * half, scale, lambda plant: at_rest(plant, held), tuple(held))


def _first(plant: Plant, of_law: str) -> Loops:
    frequencies = placed_frequencies(plant)
    return {
        axis_of(name): {"frequency": float(frequencies[POSE.index(name)]), "damping": 1.0} for name in poses_of(plant)
    }


def _moved_by(plant: Plant, name: str) -> Moved:
    at = POSE.index(name)
    return Moved(AXES[at], 2.0 * float(dynamics_of(plant).authority[at]), _SHAKEN)


KIND = TuningKind(
    trial=_trial,
    first=_first,
    loops=lambda plant, of_law: {name: (axis_of(name),) for name in poses_of(plant)},
    moved_by=_moved_by,
)
