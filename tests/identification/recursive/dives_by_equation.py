"""Dives of a float that obeys the diving model exactly, under feedback or not, for the tests of its estimators."""

import numpy as np

from auv_gym.records.record import Record
from identification.recursive.diving_model import DivingModel

NEUTRAL = 0.55  # m
# time scales of a float of 75 kg with a piston of 20 cm^2; the last two make it neutral at 0.55 m
TRUTH = DivingModel(
    damping=0.1,
    offset=0.03 * NEUTRAL**2 - 0.2358 * NEUTRAL,
    piston_rate=0.3,
    piston_square=0.03,
    piston=-0.2358,
    scheme="difference",
)
THETA = np.array([1.0, *TRUTH.parameters])


def dive_log(
    samples: int,
    noise: float,
    rng: np.random.Generator,
    model: DivingModel = TRUTH,
    closed: bool = True,
    near: float = 0.36,
) -> Record:
    """A float that goes to a new depth every minute or two; 0.7 s between samples, `near` s close to its target.

    closed: the controller acts on the noisy depth, otherwise on the true one, as if the piston had been planned.
    """
    error = noise * rng.standard_normal(samples)
    x, now, piston, target, until = model.initial(np.zeros(1)), 0.0, NEUTRAL, 10.0, rng.uniform(40.0, 120.0)
    rows, last, rate, interval = np.empty((samples, 3)), 0.0, 0.0, 0.7
    for k in range(samples):
        if now > until:
            target, until = rng.uniform(5.0, 25.0), now + rng.uniform(40.0, 120.0)
        measured = x[0] + error[k]
        seen = measured if closed else x[0]
        rate = 0.5 * rate + 0.5 * (seen - last) / interval if k else 0.0
        last, interval = seen, 0.7 if abs(seen - target) > 0.8 else near
        wanted = min(max(NEUTRAL + 0.01 * (seen - target) + 0.1 * rate, 0.5), 0.6)
        piston += min(max(wanted - piston, -0.004 * interval), 0.004 * interval)
        rows[k] = now, measured, piston
        x = model.step_over(x, np.array([piston]), interval)
        now += interval
    return Record.from_arrays(rows[:, 0], {"depth_m": rows[:, 1], "piston_m": rows[:, 2]})
