"""The sentences of a diagnosis on what it leaves unexplained: remaining errors, and what pushes at random or slowly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import listed, spec_at
from identification.deciding import SHORTEST_INTERNAL_WAVE
from identification.diagnosis.judge.result import Result
from identification.diagnosis.search.dependence import CLOCK
from identification.diagnosis.wording import accelerations, capital, lasting_errors, quantity

_NEARLY = 0.99  # of the longest correlation time that a fit allows
_LASTING = 0.25  # of the longest segment; with a longer correlation time, the noise changes only a few times in it


def rest_sentence(d: Result) -> str:
    """The part of the error that nothing explains."""
    if d.discovery is None:
        return ""
    begin = "" if d.verdict == "unexplained" else f"Part of the error remains unexplained{_small(d)}. "
    begin += left_sentence(d)
    if d.discovery.holds:
        terms = listed([t.words for t in d.discovery.terms])
        begin += f"A term found in the data and confirmed on unseen parts of the log explains part of it: {terms}. "
    return (begin + (d.habitat.summary() if d.habitat is not None else "")).strip()


def _small(d: Result) -> str:
    """If the remaining error is smaller than every sensor's noise: a clause that says so, and where it is largest."""
    beyond = {name: beyond_noise(d, name) for name in d.after.scores}
    if not all(size < d.noise_of(name) < np.inf for name, size in beyond.items()):
        return ""
    most = max(beyond, key=lambda name: beyond[name] / d.noise_of(name))
    size = quantity(beyond[most], channel(most).unit)
    return (
        f", but is smaller than the sensors' noise: free runs of {d.after.unseen.label(most)} miss by {size} beyond it"
    )


def left_sentence(d: Result) -> str:
    """The evidence that something is left, with a trailing space; empty if there is none."""
    left, shown = d.left, []
    for names, what in ((left.coloured, "are correlated in time"), (left.bursts, "come in bursts")):
        if names:
            shown.append(f"{what} ({', '.join(channel(name).label for name in names)})")
    if left.depends:
        of, pushed = channel(left.depends.signal).label, channel(left.depends.pushed).label
        law = f"past changes of {of}" if left.depends.remembers else of
        how = f"as errors of the reading of {pushed}" if left.depends.misread else f"acting on {pushed}"
        shown.append(f"depend on {law} ({how})")
    text = f"One-step prediction errors {listed(shown)}. " if shown else ""
    for names, what, does in (
        (left.gusts, "Random accelerations", "are stronger at some times than at others: something acts now and then"),
        (left.slow, "What pushes the vehicle", "lasts longer than random noise does: something acts slowly"),
        (left.misread, "Lasting sensor errors", "are larger at some times than at others"),
    ):
        if names:
            text += f"{what} ({listed([channel(name).label for name in names])}) {does}. "
    if left.changes and left.changes not in {*d.dropped, *(e.path for e in d.alike)}:
        title = spec_at(d.state.plant, left.changes).title or left.changes
        if left.changes != CLOCK:
            text += (
                f"The {title} differs between parts of the log: something changed during the log. "
                f"{capital(sought(d, 'when that was'))}. "
            )
        elif not replace(left, changes=""):  # if more is left than a clock error would cause, it is hardly the clock
            text += "What remains acts like a clock of the log whose rate differs between parts of it. "
    if left.passing:
        title = spec_at(d.state.plant, left.passing).title or left.passing
        text += (
            f"Something began, ended or changed during the log that acts like this effect: {title}. "
            f"{capital(sought(d, 'when that was'))}. "
        )
    return text


def noise_sentence(d: Result) -> str:
    """The process noise that the fit found, or nothing."""
    if d.noise is None:
        return ""
    told = []
    if d.noise.process:
        kinds = {"accelerations" if name.endswith("ps") else "drifts" for name in d.noise.process}
        pushed = accelerations(d.noise.process)
        told.append(f"Random {' and '.join(sorted(kinds))} push the vehicle (process noise): {pushed}.")
    for period, pushes in d.noise.swell.items():
        what = "Accelerations" if all(name.endswith("ps") for name in pushes) else "Drifts"
        long = period >= SHORTEST_INTERNAL_WAVE
        takes = f"{period / 60.0:.0f} min" if long else quantity(period, "s")
        of = "internal waves" if long else "waves"
        told.append(f"{what} with a period of {takes} push it, as of {of}: {accelerations(pushes)}.")
    for period, errors in d.noise.lasting.items():
        how = f"swing with a period of {quantity(period, 's')}" if period else "last"
        told.append(f"Some sensor errors {how}: {lasting_errors(errors)}.")
    return " ".join(told)


def drift_sentence(d: Result) -> str:
    """A warning that the process noise varies so slowly that it looks like an effect that begins, ends or grows."""
    if d.noise is None or d.unexplained:
        return ""
    longest = max(float(np.ptp(d.record.time[s])) for s in d.record.segments)
    slow = min(_LASTING * longest, _NEARLY * d.noise.slowest)
    names = [channel(name).label for name, (_, time) in d.noise.process.items() if time > slow]
    if not names:
        return ""
    return (
        f"What pushes {listed(names)} changes so slowly that an effect which begins, ends or grows during the log "
        f"would look like it: {sought(d, 'such an effect')}."
    )


def sought(d: Result, when: str) -> str:
    """The command that looks for changes within a log, or between several."""
    within = f"auv-gym onset looks for {when}"
    if len(set(d.record.labels)) < 2:
        return within
    return f"auv-gym compare-missions compares the logs with each other, and {within}"


def beyond_noise(d: Result, name: str) -> float:
    """The RMS error of free runs in a channel, after the diagnosis, beyond the noise of its sensor."""
    return float(np.sqrt(max(d.after.scores[name].rmse ** 2 - d.noise_of(name) ** 2, 0.0)))
