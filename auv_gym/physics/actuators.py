"""Actuator effects: from a command to the angle of a fin."""

from math import expm1, inf

from auv_gym.compiled import compiled

_GONE = 1e-250  # a decay towards zero is cut here, since denormal numbers are slow


@compiled
def play(position, memory, width):
    """Output of a backlash of full width `width` with its last output `memory`; the identity at width 0."""
    half = 0.5 * width
    return min(max(memory, position - half), position + half)


@compiled
def held(position, memory, backlash, stiction):
    """The new position of an actuator with backlash and stiction for a commanded position, given its last one.

    It sticks until the difference is `stiction` or more, and then moves all the way.
    """
    moved = play(position, memory, backlash)
    return moved if abs(moved - memory) >= stiction else memory


@compiled
def shaped_command(command, memory, gain, offset, deadband, backlash, stiction, stop):
    """A command after gain, offset, deadband, backlash, stiction and saturation at +-stop, and the new memory.

    memory: the last output of backlash and stiction.  The deadband is continuous: its output starts from zero at its
    edge. All other steps are memoryless, so the dead time, which acts on the sampled signal, may follow them.
    """
    position = command * gain + offset
    position -= min(max(position, -deadband), deadband)
    position = held(position, memory, backlash, stiction)
    stop = max(stop, 0.0)
    return min(max(position, -stop), stop), position


@compiled
def command_within(command, memory, rest, low, high, gain, offset, deadband, backlash, stiction, lost):
    """Like `shaped_command`, for an actuator that rests at `rest` within low to high, less `lost` at both ends.

    Lost travel at an end never keeps it from its rest.
    """
    position = (command - rest) * gain + offset
    position -= min(max(position, -deadband), deadband)
    position = held(rest + position, memory, backlash, stiction)
    return min(max(position, min(low + lost, rest)), max(high - lost, rest)), position


@compiled
def shape_command(command, memory, limit, actuator):
    """The commanded angle after an actuator's effects, and the new memory, rad; see `shaped_command`.

    limit: mechanical stop, rad, before `actuator.lost_travel`.
    """
    return shaped_command(
        command,
        memory,
        actuator.gain,
        actuator.offset,
        actuator.deadband,
        actuator.backlash,
        actuator.stiction,
        limit - actuator.lost_travel,
    )


@compiled
def lag_progress(lag, duration):
    """The share of its way to the target that a first-order lag has gone after a time."""
    return -expm1(-duration / lag) if lag > 0.0 else 1.0


@compiled
def travel(position, target, lag, slowness, duration, decay=-1.0):
    """Mean, slope and end of an actuator's position over a time in which its target is constant.

    First-order lag with a rate limit, dx/dt = clip((target - x)/lag, +-1/slowness), solved in closed form: a straight
    run at full rate, then an exponential. `mean + slope (t - duration/2)` has the exact zeroth and first moment of the
    position, so forces computed from it keep a fourth-order integrator's order and are correct however small the lag
    is.
    lag: s.  slowness: s/rad, the inverse of the rate limit.  decay: `lag_progress(lag, duration)`, if known.
    Source: Fossen 2021, sec. 9.7 (lag, rate limit).
    """
    error = position - target
    if abs(error) < _GONE or (lag <= 0.0 and slowness <= 0.0):
        return target, 0.0, target
    side = 1.0 if error > 0.0 else -1.0
    size = abs(error)
    run = 0.0
    knee = lag / slowness if slowness > 0.0 else inf
    area = 0.0
    moment = 0.0
    if size > knee:
        run = min((size - knee) * slowness, duration)
        area = size * run - run * run / (2.0 * slowness)
        moment = size * run * run / 2.0 - run * run * run / (3.0 * slowness)
        size -= run / slowness
    rest = duration - run
    if rest > 0.0 and lag > 0.0:
        gone = decay if run == 0.0 and decay >= 0.0 else lag_progress(lag, rest)
        area += size * lag * gone
        moment += size * lag * (run * gone + lag * gone - rest * (1.0 - gone))
        size *= 1.0 - gone
    elif rest > 0.0:
        size = 0.0
    moment -= 0.5 * duration * area
    return target + side * area / duration, side * 12.0 * moment / duration**3, target + side * size
