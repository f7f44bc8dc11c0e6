"""The frequency response of a closed loop, measured by exciting its command in simulation, and its margins."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, log, pi
from typing import NamedTuple

import numpy as np

from auv_gym.channels import excitation_of, set_point_of
from auv_gym.model import Diverged
from controllers.composed.excited import Excited
from controllers.controller import Controller
from controllers.kinds import KINDS as CONTROL
from controllers.trials.trial import run_trial
from controllers.tuning.bench import Bench
from controllers.tuning.kinds import KINDS

_LEAD, _PERIOD = 30.0, 60.0  # time scales of the vehicle: for settling, and period of the signal
_LINES = 40  # number of frequencies in the signal
_CREST = 3.0  # approximate ratio of a multisine's peak to its RMS
# energy of the response at frequencies outside the signal, over that at its frequencies: small for a loop that settles,
# and comparable for one that grows or is in a limit cycle
_STRANGE = 0.1
_FINE = 600  # number of frequencies between which margins are searched for


class Margins(NamedTuple):
    """Margins of a loop broken at its command: dB, deg, s, and the peak of |1 / (1 + L)|.

    gain: the smaller of the possible increase and decrease of the gain.  0, with an infinite peak, if the loop does not
    settle.
    """

    gain_margin_db: float
    phase_margin_deg: float
    delay_margin_s: float
    sensitivity_peak: float


UNSETTLED = Margins(0.0, 0.0, 0.0, inf)


@dataclass(frozen=True, eq=False)
class Response:
    """The loop L from the acting command to the returned one, with the sign reversed, at omega, rad/s.

    settled: whether it reached a periodic motion at all.
    """

    omega: np.ndarray
    loop: np.ndarray
    settled: bool

    def margins(self) -> Margins:
        """The margins; infinite if the loop has no such crossing within its frequencies."""
        return margins_of(self.omega, self.loop) if self.settled else UNSETTLED


def loop_response(bench: Bench, at: int, controller: Controller, name: str, bow_share: float = 0.0) -> Response:
    """The response of the loop of a channel on one of the bench's plants, at its start.

    All loops are closed, and a periodic signal is added to the command; its lines in the acting command give S = 1 / (1
    + L).  bow_share: movement of bow planes relative to the stern planes in this controller.
    Source: Ljung 1999, System Identification, sec. 13.3 (periodic inputs), and 13.4 (direct and indirect methods).
    """
    plant, trial = bench.plants[at], bench.trial
    kind = KINDS.of(plant.family)
    command, span, share = kind.moved_by(bench.plants[0], name)
    period = round(_PERIOD * trial.scale / plant.dt)
    lead = round(_LEAD * trial.scale / plant.dt)
    # only odd lines: what appears between them is not a response to the signal
    lines = 2 * np.unique(np.geomspace(1.0, 0.22 * period, _LINES).round().astype(int)) - 1
    signal = share * span * _multisine(period, lines)
    signal *= min(1.0, _room(bench, at, command) / (_CREST * share * span))
    whole = np.roll(np.tile(signal, 2 + lead // period), lead)[: lead + period + 1]
    together = {command: 1.0, **kind.mirror(plant, name, bow_share)}
    shaken = Excited(controller, {other: factor * whole for other, factor in together.items()}, plant.dt)
    now = dict(zip(plant.outputs, plant.output(bench.starts[at][0]).tolist(), strict=True))
    held = {other: [(0.0, now[other])] for other in trial.held}  # values that this vehicle can hold
    try:
        run = run_trial(plant, shaken, held, (lead + period) * plant.dt, start=bench.starts[at])
    except (Diverged, OverflowError):
        return Response(np.array([1.0]), np.array([0j]), False)
    acting = run.get(set_point_of(command), run[command])
    added = np.fft.rfft(run[excitation_of(command)][lead:-1])[lines]
    # remove a linear drift: the signal is the same at both ends
    periodic = acting[lead:-1] - np.arange(period) / period * (acting[-1] - acting[lead])
    answer = np.fft.rfft(periodic)
    energy, answered = np.abs(answer[1:]) ** 2, np.abs(answer[lines]) ** 2
    settled = bool(energy.sum() - answered.sum() < _STRANGE * answered.sum())
    return Response(2.0 * pi * lines / (period * plant.dt), added / answer[lines] - 1.0, settled)


def margins_of(omega: np.ndarray, loop: np.ndarray) -> Margins:
    """The margins of a loop that is stable in closed loop, from its response; interpolated between its frequencies."""
    fine = np.geomspace(omega[0], omega[-1], _FINE)
    size = np.interp(np.log(fine), np.log(omega), np.log(np.maximum(np.abs(loop), 1e-300)))
    phase = np.interp(np.log(fine), np.log(omega), np.unwrap(np.angle(loop)))
    found = np.exp(size + 1j * phase)
    over = _crossings(size)
    left = np.mod(_at(over, phase) + pi, 2.0 * pi)  # lag before -180 deg
    full = _crossings(np.mod(phase, 2.0 * pi) - pi)  # which jumps where the phase is 0
    return Margins(
        gain_margin_db=float(20.0 / log(10.0) * np.abs(_at(full, size)).min(initial=inf)),
        phase_margin_deg=float(np.rad2deg(np.minimum(left, 2.0 * pi - left)).min(initial=inf)),
        delay_margin_s=float((left / np.exp(_at(over, np.log(fine)))).min(initial=inf)),
        sensitivity_peak=float((1.0 / np.abs(1.0 + found)).max()),
    )


def _crossings(values: np.ndarray) -> np.ndarray:
    """Fractional indices at which values cross zero without a jump."""
    before, after = values[:-1], values[1:]
    at = np.flatnonzero((np.sign(before) != np.sign(after)) & (np.abs(after - before) < pi))
    return at + before[at] / (before[at] - after[at])


def _at(places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Values at fractional indices."""
    return np.interp(places, np.arange(values.size), values)


def _multisine(period: int, lines: np.ndarray) -> np.ndarray:
    """One period of cosines at these lines with an RMS of 1; the phases keep its peaks low."""
    turns = 2.0 * pi * np.outer(np.arange(period), lines) / period
    choices = np.random.default_rng(0).uniform(0.0, 2.0 * pi, (8, lines.size))
    sums = (np.cos(turns + phases).sum(axis=1) for phases in choices)
    best = min(sums, key=lambda values: float(np.abs(values).max()))
    return best / best.std()


def _room(bench: Bench, at: int, command: str) -> float:
    """The range of a command to either side of its initial value; infinite for an axis of a wrench."""
    plant = bench.plants[at]
    if command not in plant.inputs:
        return inf
    (low, high), start = CONTROL.of(plant.family).ranges(plant)[command], bench.starts[at][1]
    value = float(start[plant.inputs.index(command)])
    return min(high - value, value - low)
