"""The sizes of stiction worth trying: those with which an actuator follows the commands of a record differently."""

from __future__ import annotations

import numpy as np

from auv_gym.model import inputs_of
from auv_gym.param import replace_at, spec_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.changing import ChangingPlant, changed

_RANGE, _STEP = (0.3, 9.0), 1.01  # of the sizes, in probes, and from one to the next; of alike ones, one is kept
_APART = 0.3  # relative difference between two movements, from which on both are tried
# sizes, since each one costs a run of the vehicle in each screening: of vehicles up to so many states; fewer of others,
# and of effects that may act at any of many times
_MOST, _MANY_STATES, _FEWER = 150, 6, 50


def sticking_sizes(plant: Plant, record: Record, path: str) -> tuple[float, ...]:
    """Sizes of stiction, in probes, with which an actuator follows the commands of a record in different ways.

    One size for each way, at most 150, or 50 for a vehicle in six degrees of freedom or an effect that acts at some
    times only, which take longer: a command that is followed or missed changes all that comes after it, so that sizes
    1 % apart may have little in common.
    Empty if no size within the range of the parameter makes a difference.
    """
    always = not changed(path)[0]
    while changed(path)[0]:
        path = changed(path)[1]
    spec, plain = spec_at(plant, path), plant.plain if isinstance(plant, ChangingPlant) else plant
    sizes = np.geomspace(*_RANGE, 1 + round(np.log(_RANGE[1] / _RANGE[0]) / np.log(_STEP)))
    sizes = sizes[spec.neutral + sizes * spec.probe <= spec.bounds[1]]
    free = _movements(replace_at(plain, path, spec.neutral), record)
    stuck = _movements(replace_at(plain, path, spec.bounds[1]), record)
    moved = np.flatnonzero((free != stuck).any(axis=0))
    if not moved.size:
        return ()
    apart, effect = np.zeros(len(sizes) - 1), np.zeros(len(sizes))
    for segment in record.segments:
        position = free[segment, moved[0]]
        held = np.full(len(sizes), position[0])
        for now in position:
            held = np.where(np.abs(now - held) >= sizes * spec.probe, now, held)
            apart += np.diff(held) ** 2
            effect += (held - now) ** 2
    # the sum of relative changes from one size to the next, along which ways are an equal distance apart
    relative = np.minimum(apart / np.maximum(np.minimum(effect[1:], effect[:-1]), 1e-300), 1.0)
    along = np.r_[0.0, np.cumsum(relative)]
    most = _MOST if always and len(plant.family.states) <= _MANY_STATES else _FEWER
    ways = np.minimum(np.floor(along / max(_APART**2, along[-1] / most)), most - 1)
    acts = effect > 0.0
    return tuple(float(np.median(sizes[acts & (ways == way)])) for way in np.unique(ways[acts]))


def _movements(plant: Plant, record: Record) -> np.ndarray:
    """The positions that the commands of a record ask of the actuators, before dead times and lags, (n, n_actuators).

    At the beginning of a segment, the actuators are where its first commands put them.
    """
    inputs, parameters, shape = inputs_of(plant, record), plant.family.view(plant.derived), plant.family.hooks.shape
    positions = np.zeros((len(inputs), len(plant.family.actuators)))
    for segment in record.segments:
        memory = inputs[segment.start, : positions.shape[1]].copy()
        shape(inputs[segment.start], memory, parameters, positions[segment.start])
        memory[:] = positions[segment.start]
        for row in range(segment.start, segment.stop):
            shape(inputs[row], memory, parameters, positions[row])
    return positions
