"""Excitation signals: added to a command or a set point, or as slow disturbances.

`make_signal` makes them by name. An excitation that depends on the vehicle's response (a zigzag) is a controller: see
`controllers.relay`.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from math import ceil, inf, pi, radians
from typing import Any, Final, cast

import numpy as np
from scipy.signal import chirp as swept, max_len_seq

from auv_gym.param import check_count, did_you_mean
from identification.experiments.multisine import multisine

_LONGEST_REGISTER = 31


def check_generator(name: str, rng: Any) -> None:
    """Raise an error that names the caller, `name`, if this does not draw random numbers."""
    if not isinstance(rng, np.random.Generator):
        seed = rng if isinstance(rng, int) else 0
        raise ValueError(f"{name} needs rng as a generator, got {rng!r}: give numpy.random.default_rng({seed}).")


def prbs(n: int, hold: int, amplitude: float, rng: np.random.Generator) -> np.ndarray:
    """A pseudo-random binary signal of -amplitude and +amplitude, shape (n,), each bit `hold` samples long.

    The shortest maximum-length sequence that does not repeat within n, from a drawn phase.
    Source: Ljung 1999, System Identification, sec. 13.3.

    Example:

        >>> import numpy as np
        >>> from identification import prbs
        >>> prbs(8, 2, 0.1, np.random.default_rng(0))
        array([ 0.1, -0.1, -0.1,  0.1,  0.1, -0.1, -0.1, -0.1])
    """
    check_count("prbs: n", n)
    check_count("prbs: hold", hold)
    check_generator("prbs", rng)
    bits = max(ceil(n / hold).bit_length(), 2)
    sequence = np.roll(max_len_seq(bits)[0], int(rng.integers(2**bits - 1)))
    lengthened = np.repeat(2.0 * sequence - 1.0, hold)
    start = int(rng.integers(hold)) if lengthened.size - n >= hold else 0
    return amplitude * lengthened[start : start + n]


def set_point_steps(
    time: np.ndarray,
    rng: np.random.Generator,
    *,
    start: float = 0.0,
    hold: tuple[float, float] = (40.0, 90.0),
    step: tuple[float, float] = (radians(20.0), radians(70.0)),
) -> np.ndarray:
    """A set point at each time, shape (n,), that starts at `start` and changes in random steps of either sign.

    time: s, rising.  hold: s, range of the time between changes.  step: range of a change's size, in the signal's unit.
    """
    check_generator("set_point_steps", rng)
    time = np.asarray(time, dtype=float)
    if not 0.0 < hold[0] <= hold[1]:
        raise ValueError(f"set_point_steps needs 0 < hold[0] <= hold[1] in s, got {hold}.")
    values = np.full(time.size, float(start))
    change = time[0] + rng.uniform(0.0, hold[0])
    while change <= time[-1]:
        values[time >= change] += rng.uniform(*step) * (1.0 if rng.random() < 0.5 else -1.0)
        change += rng.uniform(*hold)
    return values


def slow_variation(
    time: np.ndarray, rng: np.random.Generator, *, amplitude: float, periods: tuple[float, float] = (60.0, 200.0)
) -> np.ndarray:
    """A smooth signal around zero with the maximum `amplitude`, shape (n,): three sines of random period and phase.

    time, periods: s.  Periods are log-uniformly distributed.
    """
    time = np.asarray(time, dtype=float)
    angular = 2.0 * pi / np.exp(rng.uniform(*np.log(periods), size=3))
    phases, shares = rng.uniform(0.0, 2.0 * pi, size=3), rng.uniform(0.5, 1.0, size=3)
    waves = shares[:, None] * np.sin(angular[:, None] * time + phases[:, None])
    total = waves.sum(axis=0)
    return amplitude * total / max(float(np.abs(total).max()), 1e-12)


def maximum_length(
    n: int,
    dt: float,
    rng: np.random.Generator,
    *,
    amplitude: float,
    clock_s: float | None = None,
    register: int | None = None,
) -> np.ndarray:
    """A maximum-length pseudo-random binary signal of +-amplitude, shape (n,), with a random starting bit.

    clock_s: duration of a bit, a whole number of samples, default one.  register: bits of the shift register; the
    signal repeats after N = 2**register - 1 bits; default the shortest that does not repeat within n.
    Over a period the autocorrelation is amplitude**2 at zero and -amplitude**2 / N from one clock on; the power
    spectrum has lines k / (N clock_s) of amplitude**2 (N + 1) / N**2 sinc(k / N)**2, and amplitude**2 / N**2 at zero
    frequency.
    Source: Golomb 1967, Shift Register Sequences; Ljung 1999, System Identification, sec. 13.3.
    """
    hold = 1 if clock_s is None else _samples("prbs", "clock_s", clock_s, dt)
    bits = ceil(n / hold)
    if register is None:
        register = max(bits.bit_length(), 2)
    if not 2 <= register <= _LONGEST_REGISTER:
        raise ValueError(f"prbs needs a register of 2 to {_LONGEST_REGISTER} bits, got {register}: lengthen clock_s.")
    state = [int(bit) for bit in f"{int(rng.integers(1, 2**register)):0{register}b}"]
    sequence = max_len_seq(register, state=state, length=bits)[0]
    return amplitude * np.repeat(2.0 * sequence - 1.0, hold)[:n]


def chirp(
    n: int,
    dt: float,
    rng: np.random.Generator,
    *,
    amplitude: float,
    band_Hz: Sequence[float],
    law: str = "linear",
) -> np.ndarray:
    """A chirp: a sine whose frequency goes from band_Hz[0] to band_Hz[1] over the signal, shape (n,).

    law: "linear" spends the same time on each Hz, "log" on each octave.  The band may run downwards.  Uses no random
    numbers.
    Source: Pintelon and Schoukens 2012, System Identification, sec. 5.3.

    Example:

        >>> import numpy as np
        >>> from identification import chirp
        >>> chirp(5, 1.0, np.random.default_rng(0), amplitude=0.2, band_Hz=(0.05, 0.2)).round(2)
        array([0.  , 0.08, 0.17, 0.2 , 0.07])
    """
    first, last = map(float, band_Hz)
    if not (min(first, last) > 0.0 and max(first, last) <= 0.5 / dt):
        raise ValueError(
            f"chirp needs band_Hz above 0 and up to {0.5 / dt:g}, half the samples per s, got {band_Hz!r}."
        )
    if law not in ("linear", "log"):
        raise ValueError(f"chirp knows the laws 'linear' and 'log', got {law!r}.")
    method = "linear" if law == "linear" or first == last else "logarithmic"
    return amplitude * swept(dt * np.arange(n), first, n * dt, last, method=method, phi=-90)


def doublet(
    n: int,
    dt: float,
    rng: np.random.Generator,
    *,
    amplitude: float,
    width_s: float,
    widths: Sequence[float] = (1, 1),
    repeat_s: float | None = None,
) -> np.ndarray:
    """Alternating pulses of +amplitude and -amplitude, then zero, shape (n,).  Uses no random numbers.

    width_s: of a pulse of width 1, a whole number of samples.  widths: of the pulses; (3, 2, 1, 1) is the 3-2-1-1
    input, which has a wider band.  repeat_s: from one start to the next; default: no repetition.
    Source: Jategaonkar 2015, Flight Vehicle System Identification, sec. 2.3.

    Example:

        >>> import numpy as np
        >>> from identification import doublet
        >>> doublet(8, 1.0, np.random.default_rng(0), amplitude=0.2, width_s=2.0)
        array([ 0.2,  0.2, -0.2, -0.2,  0. ,  0. ,  0. ,  0. ])
    """
    one = _samples("doublet", "width_s", width_s, dt)
    lengths = [round(one * width) for width in widths]
    if not lengths or min(lengths) < 1:
        raise ValueError(f"doublet needs widths of at least a sample, got {list(widths)} times {width_s:g} s.")
    pulses = np.repeat(np.where(np.arange(len(lengths)) % 2 == 0, 1.0, -1.0), lengths)
    every = n if repeat_s is None else _samples("doublet", "repeat_s", repeat_s, dt)
    if every < pulses.size and repeat_s is not None:
        raise ValueError(f"doublet takes {pulses.size * dt:g} s, got repeat_s {repeat_s:g}: give that or more.")
    period = np.concatenate([pulses, np.zeros(max(every - pulses.size, 0))])
    return amplitude * np.resize(period, n)


def bang_bang(
    n: int, dt: float, rng: np.random.Generator, *, amplitude: float, hold_s: float | Sequence[float]
) -> np.ndarray:
    """A signal that switches between +amplitude and -amplitude, shape (n,).

    hold_s: the time between changes: a number for a square wave that begins with +amplitude, or a range from which each
    time is drawn, with a random initial sign.
    """
    time, (low, high) = dt * np.arange(n), _holds("bang_bang", hold_s, dt)
    drawn = not isinstance(hold_s, int | float)
    side = -1.0 if drawn and rng.random() < 0.5 else 1.0
    return amplitude * side * np.where(_changes(time, rng, low, high) % 2 == 0, 1.0, -1.0)


def telegraph(n: int, dt: float, rng: np.random.Generator, *, amplitude: float, dwell_s: float) -> np.ndarray:
    """A random telegraph signal of +amplitude and -amplitude, shape (n,): at each sample it may change sign at random.

    dwell_s: the mean time between changes, longer than a sample; the times are memoryless, so that some are many times
    longer.  Samples k apart have the covariance amplitude**2 (1 - 2 dt / dwell_s)**k.
    Source: Papoulis and Pillai 2002, Probability, Random Variables and Stochastic Processes, sec. 9.2.
    """
    if not (_is_number(dwell_s) and dt < dwell_s < inf):
        raise ValueError(f"telegraph needs dwell_s above one sample ({dt:g} s), got {dwell_s!r}.")
    first = -1.0 if rng.random() < 0.5 else 1.0
    changes = np.cumsum(rng.random(n - 1) < dt / dwell_s)
    return amplitude * first * np.where(np.concatenate([[0], changes]) % 2 == 0, 1.0, -1.0)


def steps(
    n: int, dt: float, rng: np.random.Generator, *, amplitude: float, hold_s: float | Sequence[float]
) -> np.ndarray:
    """Levels drawn uniformly between -amplitude and +amplitude, shape (n,): shows effects that are nonlinear.

    hold_s: how long a level is held, or a range from which that is drawn.
    Source: Nelles 2001, Nonlinear System Identification, sec. 17.7 (APRBS).
    """
    at = _changes(dt * np.arange(n), rng, *_holds("steps", hold_s, dt))
    return amplitude * rng.uniform(-1.0, 1.0, size=int(at[-1]) + 1)[at]


SIGNALS: Final[Mapping[str, Callable[..., np.ndarray]]] = {
    "prbs": maximum_length,
    "multisine": multisine,
    "chirp": chirp,
    "doublet": doublet,
    "bang_bang": bang_bang,
    "telegraph": telegraph,
    "steps": steps,
}


def make_signal(
    kind: str,
    n: int,
    dt: float,
    rng: np.random.Generator,
    *,
    start_s: float = 0.0,
    duration_s: float | None = None,
    **settings: Any,
) -> np.ndarray:
    """A signal of one of the SIGNALS at samples dt apart, shape (n,); zero before start_s and after duration_s.

    settings: those of the kind.  Raises ValueError that names the settings of the kind.

    Example:

        >>> import numpy as np
        >>> from identification import make_signal
        >>> make_signal("prbs", 6, 1.0, np.random.default_rng(0), amplitude=0.1, clock_s=2.0)
        array([ 0.1,  0.1,  0.1,  0.1, -0.1, -0.1])
    """
    if kind not in SIGNALS:
        raise ValueError(f"No signal {kind!r}. {did_you_mean(kind, SIGNALS)}Kinds: {', '.join(SIGNALS)}.")
    allowed = signal_settings(kind)
    listed = f"{kind} takes {', '.join(allowed)}, start_s and duration_s"
    for name in settings:
        if name not in allowed:
            raise ValueError(f"Signal {kind!r} has no setting {name!r}. {did_you_mean(name, allowed)}{listed}.")
    missing = [name for name, needed in allowed.items() if needed and name not in settings]
    if missing:
        raise ValueError(f"Signal {kind!r} needs {' and '.join(missing)}: {listed}.")
    amplitude = settings["amplitude"]
    if not _is_number(amplitude) or not 0.0 < amplitude < inf:
        raise ValueError(f"Signal {kind!r} needs amplitude > 0, in its channel's unit, got {amplitude!r}.")
    check_generator("make_signal", rng)
    if n < 1 or not 0.0 < dt < inf:
        raise ValueError(f"A signal needs n >= 1 samples and dt > 0 s, got n = {n} and dt = {dt!r}.")
    first = _samples(kind, "start_s", start_s, dt) if start_s else 0
    last = n if duration_s is None else min(first + _samples(kind, "duration_s", duration_s, dt), n)
    if first >= n:
        raise ValueError(f"Signal {kind!r} would start at {start_s:g} s, after the end at {n * dt:g} s.")
    signal = np.zeros(n)
    try:
        signal[first:last] = SIGNALS[kind](last - first, dt, rng, **settings)
    except TypeError as error:  # for example, a text instead of a number
        raise ValueError(f"Signal {kind!r} cannot be made of {settings!r}: {error}.") from None
    return signal


def signal_settings(kind: str) -> dict[str, bool]:
    """The settings of a kind of signal by name, and whether each is required."""
    given = inspect.signature(SIGNALS[kind]).parameters.values()
    return {p.name: p.default is p.empty for p in given if p.kind is p.KEYWORD_ONLY}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _samples(kind: str, name: str, value: Any, dt: float) -> int:
    """A time as a number of samples, at least one; raises if it is not a whole number of them."""
    count = round(value / dt) if _is_number(value) and 0.0 < value < inf else 0
    if count < 1 or abs(count * dt - value) > 1e-6 * value:
        raise ValueError(f"Signal {kind!r} needs {name} as a whole number of samples of {dt:g} s, got {value!r}.")
    return count


def _holds(kind: str, hold: float | Sequence[float], dt: float) -> tuple[float, float]:
    """The range of a hold, s; a single number gives a range of zero width."""
    if _is_number(hold):
        steady = dt * _samples(kind, "hold_s", hold, dt)
        return steady, steady
    low, high = map(float, cast("Sequence[float]", hold))
    if not dt <= low <= high < inf:
        raise ValueError(f"Signal {kind!r} needs hold_s from one sample ({dt:g} s) on, low before high, got {hold!r}.")
    return low, high


def _changes(time: np.ndarray, rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """The number of changes so far at each time; the intervals between changes are drawn from low to high s."""
    holds = rng.uniform(low, high, size=ceil((time[-1] - time[0]) / low) + 1)
    return np.searchsorted(time[0] + np.cumsum(holds) - 1e-6 * low, time, side="right")
