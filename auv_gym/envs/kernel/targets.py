"""Targets that change in steps, and time steps of constant length: compiled parts shared by kinds of vehicle."""

from __future__ import annotations

from math import isnan

from auv_gym.compiled import compiled
from auv_gym.envs.kernel.layout import CHANGE_DRAWS, START_DRAWS
from auv_gym.physics.frames import wrapped


@compiled
def target_error(value, t, e):
    """The target minus a value of its channel."""
    error = e.target[0] - value
    return wrapped(error) if t.is_angle != 0.0 else error


@compiled
def tracking_term(x, t, e):
    """The reward term of the true state x, for the target for which the action was chosen."""
    return -t.weight[0] * min(abs(target_error(x[int(t.true_index)], t, e)) / t.error_scale, 1.0)


@compiled
def draw_target(t, e, row):
    """Draw a new target if the present one has expired."""
    if isnan(t.fixed_target) and e.time >= e.change_at - 1e-9:
        at = int(t.draws_at) + START_DRAWS + int(t.randomised) + CHANGE_DRAWS * (int(e.change) % int(t.changes))
        e.change += 1.0
        step = t.target_step[0] + (t.target_step[1] - t.target_step[0]) * row[at]
        if row[at + 1] < 0.5:
            step = -step
        if e.target[0] + step < t.target_band[0] or e.target[0] + step > t.target_band[1]:
            step = -step
        e.target[0] = min(max(e.target[0] + step, t.target_band[0]), t.target_band[1])
        if t.is_angle != 0.0:
            e.target[0] = wrapped(e.target[0])
        e.change_at = e.time + t.target_hold[0] + (t.target_hold[1] - t.target_hold[0]) * row[at + 2]


@compiled
def first_target(x, t, e, row):
    """Set the first target of an episode: a step from the vehicle's initial value, or the given target."""
    e.target[0] = x[int(t.true_index)]
    draw_target(t, e, row)
    if not isnan(t.fixed_target):
        e.target[0] = t.fixed_target
    if not isnan(e.first_target):
        e.target[0] = e.first_target


@compiled
def put_constants(plan, drawn, t, e):
    """Set all inputs to rest, and constant inputs to this episode's parameters."""
    for j in range(e.command.shape[0]):
        e.command[j] = 0.0
    at = int(t.constants_at)
    for _ in range(int(t.constants)):
        e.command[int(plan[at])] = drawn[int(plan[at + 1])]
        at += 2


# Hooks of kinds with time steps of constant length.


def pass_time(t, e, row):
    """Put the time after one more step into e.time."""
    e.time = e.step * t.dt


def steps_left(t, e):
    """The number of steps left in the episode."""
    return t.steps - e.step


def ages(plan, t, row):
    """The times of stored commands, which are the same for all rows."""
    at = int(t.ages_at)
    return plan[at : at + int(t.history) + 1]


# Hooks of kinds whose targets are values of a channel, and which have no learned forces.


def aim(plan, x, t, e, row):
    """Draw a new target if the present one has expired."""
    draw_target(t, e, row)


def set_out(plan, x, t, e, row):
    """Set the first target of an episode."""
    first_target(x, t, e, row)


def doubt(x, derived, e, work):
    """Do nothing, since no forces are learned."""
