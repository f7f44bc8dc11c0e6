"""The findings of a comparison of missions, in sentences and as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from auv_gym.param import spec_at
from auv_gym.plant import Plant
from auv_gym.writing import finite
from identification.changes.missions import AFTER, BEFORE, Changed, Common, Comparison, Unchanged
from identification.changes.moments import Moment
from identification.changes.onset import Timed, Timeline
from identification.changes.series import MissionStep, Series, Trend
from identification.changes.spans import BETWEEN, OUTSIDE
from identification.changes.timed_forms import FROM, GROWING, UNTIL
from identification.diagnosis.wording import capital, inside, interval, quantity, sized

_FAR = 3.0  # half intervals; a larger scatter is not a trend, but a difference that needs an explanation
_WHEN = {  # when an effect acts, by its form
    BEFORE: "in the earlier missions only",
    AFTER: "in the later missions only",
    FROM: "from some time on",
    UNTIL: "until some time",
    GROWING: "growing",
    BETWEEN: "between two times",
    OUTSIDE: "except between two times",
}
_LISTED = 6  # logs; with more of them, only the page and the file have the size in each
_TOLD = 4  # unchanged parameters in the summary; the page has all of them


def summary(found: Comparison) -> list[str]:
    """What changed, what is the same on both sides, and the smallest detectable changes; one sentence each."""
    lines = [changed_words(c, found.plant) for c in found.changed] or ["No change was found between these missions."]
    lines += [common_words(c, found.plant) for c in found.common]
    steady = [u for u in found.unchanged if np.isfinite(u.detectable)][:_TOLD]
    if steady:
        told = "; ".join(f"{named(u)}, {size_of(u.detectable, u)}" for u in steady)
        other = "No other change was found. " if found.changed else ""
        lines.append(f"{other}The smallest detectable changes are: {told}.")
    return lines


def changed_words(c: Changed, plant: Plant) -> str:
    """`The rudder offset changed from 0.0 deg to 2.9 deg`, with the interval of the change."""
    text = f"{capital(named(c))} changed from {quantity(c.before.value, c.unit)} to "
    text += f"{quantity(c.after.value, c.unit)}: by {quantity(c.change.value, c.unit)}{_relative(c)} "
    text += f"(95 % interval {interval(c.change.ci95, c.unit)})."
    if c.tied:
        text += f" The missions cannot tell this from: {tied_words(c.tied, plant)}."
        text += "" if c.surely else " So it is not certain that anything has changed."
    if c.moment is not None:
        when, limits = moment_words(c.moment)
        text += f" It changed {when}{f' (95 % interval {limits})' if limits else ''}"
        text += "." if limits else ": no other time explains the logs better."
    if 0 < len(c.sizes) <= _LISTED:
        text += f" In each log: {', '.join(f'{one.log} {quantity(one.value, c.unit)}' for one in c.sizes)}."
    return text


def moment_words(m: Moment) -> tuple[str, str]:
    """When a parameter changed, and the 95 % interval: `within a.nc, 12 s after its beginning`, `8 to 16 s`."""
    if m.ci95 is None:
        limits = ""
    elif m.time is None:
        limits = " to ".join(f"{one.time:.0f} s of {one.log}" for one in m.ci95)
    else:
        limits = f"{m.ci95[0].time:.0f} to {m.ci95[1].time:.0f} s"
    if m.time is None:
        return f"between {m.between[0]} and {m.between[1]}", limits
    return f"within {m.time.log}, {m.time.time:.0f} s after its beginning", limits


def tied_words(tied: Sequence[str], plant: Plant, beside: str = "") -> str:
    """The alternatives by title, with when they act: `yaw moment (until some time), rudder offset`.

    beside: the form of what they are alternatives to; if it has one, those without are said to act throughout.
    """
    split = [name.rpartition(" ")[::2] for name in tied]
    return ", ".join(f"{spec_at(plant, path).title or path}{_when_of(form, path, beside)}" for form, path in split)


def _when_of(form: str, path: str, beside: str) -> str:
    """When an alternative acts, in brackets."""
    if form in (BEFORE, AFTER) and not path.startswith("effects."):
        return " (changed)"
    if form:
        return f" ({_WHEN[form]})"
    return " (throughout)" if beside else ""


def common_words(c: Common, plant: Plant) -> str:
    size = sized(c.title, inside(c.size.value, c.size.ci95, c.unit), interval(c.size.ci95, c.unit))
    text = f"The model is missing the same effect before and after: {size}."
    return text + (f" The missions cannot tell this from: {tied_words(c.tied, plant)}." if c.tied else "")


def timeline_summary(found: Timeline) -> list[str]:
    """What is missing and when it acts, one sentence each."""
    return [timed_words(t, found.plant) for t in found.found] or [
        "The model explains this log: no known effect is missing at any time."
    ]


def timed_words(t: Timed, plant: Plant) -> str:
    """A sentence such as `Rudder offset, 1.7 deg (95 % interval 1.6 to 1.8 deg), from 396 s on (95 % ...).`"""
    text = sized(t.title, inside(t.size.value, t.size.ci95, t.unit), interval(t.size.ci95, t.unit))
    text = f"{'' if t.path.startswith('effects.') else 'a change of '}{text}"
    text = capital(text)
    if t.second is not None and t.time is not None:
        first, last = (f"{one.value:.0f} s ({one.ci95[0]:.0f} to {one.ci95[1]:.0f} s)" for one in (t.time, t.second))
        text += f", {'except ' if t.form == OUTSIDE else ''}between {first} and {last}."
    elif t.time is not None:
        when, limits = when_words(t)
        text += f", {when} (95 % interval {limits})."
    elif not t.steady:
        text += ", but parts of the log contradict each other on its size: it is not known when it acts."
    else:
        text += ", which grows from zero to this size over the log." if t.form else ", throughout the log."
    return text + (f" The log cannot tell this from: {tied_words(t.tied, plant, t.form)}." if t.tied else "")


def timeline_json(found: Timeline) -> dict[str, Any]:
    """The timeline as plain data, SI throughout."""
    return {
        "vehicle": found.plant.name,
        "summary": timeline_summary(found),
        "found": [_plain(t) for t in found.found],
        "candidates": found.candidates,
        "span": list(found.span),
        "notes": list(found.notes),
    }


def when_words(t: Timed) -> tuple[str, str]:
    """When an effect acts, and the 95 % intervals of its times: `from 396 s on`, `384 to 404 s`."""
    times = [one for one in (t.time, t.second) if one is not None]
    at = [f"{one.value:.0f}" for one in times]
    limits = ", ".join(f"{one.ci95[0]:.0f} to {one.ci95[1]:.0f} s" for one in times)
    if len(at) == 2:
        return f"{'except ' if t.form == OUTSIDE else ''}between {at[0]} and {at[1]} s", limits
    if at:
        return f"{t.form} {at[0]} s{' on' if t.form == FROM else ''}", limits
    if not t.steady:
        return "not known: parts of the log contradict each other", ""
    return "growing from zero to this size" if t.form else "throughout", ""


def series_summary(found: Series) -> list[str]:
    """Each trend, significant or not, in a sentence."""
    lines = []
    for t in found.trends:
        size, limits = rate_of(t)
        rate = f"{size} a {t.per} (95 % interval {limits})"
        lines.append(f"{capital(named(t))} {'changes by' if t.sure else 'shows no trend:'} {rate}.")
        if t.tied:
            lines[-1] += f" The missions cannot tell this from: {tied_words(t.tied, found.plant)}."
        if t.step is not None:
            lines[-1] += f" {mission_step_words(t.step, t.unit)}"
        elif not t.sure and t.scatter > _FAR * max(0.5 * (s.ci95[1] - s.ci95[0]) for s in t.sizes):
            lines[-1] += " The missions differ by far more than their own intervals, but not along a line."
    return lines or ["Too few of the missions show any parameter, so there is no trend to report."]


def mission_step_words(step: MissionStep, unit: str) -> str:
    """A sentence on the step of a parameter between two missions."""
    values = f"from {quantity(step.before.value, unit)} to {quantity(step.after.value, unit)}"
    change = f"by {quantity(step.change.value, unit)} (95 % interval {interval(step.change.ci95, unit)})"
    return f"One step explains the missions better than a line: {values}, {change}, {since_words(step)}."


def since_words(step: MissionStep) -> str:
    """The mission from which on a parameter has its later value: `from dive5.nc on (95 % interval dive4.nc to ...)`."""
    first, last = step.ci95
    return f"from {step.mission} on" + ("" if first == last else f" (95 % interval {first} to {last})")


def rate_of(t: Trend) -> tuple[str, str]:
    """A rate and its interval; for coefficients, in percent of the missions' mean."""
    whole = _whole(t)
    if whole is None:
        return inside(t.rate.value, t.rate.ci95, t.unit), interval(t.rate.ci95, t.unit)
    size, low, high = (f"{100.0 * rate / whole:+.3g}" for rate in (t.rate.value, *t.rate.ci95))
    return f"{size} %", f"{low} to {high} %"


def scatter_of(t: Trend) -> str:
    """The scatter of the missions, in the unit of `rate_of`."""
    whole = _whole(t)
    return quantity(t.scatter, t.unit) if whole is None else f"{100.0 * t.scatter / whole:.3g} %"


def _whole(t: Trend) -> float | None:
    """The value of a coefficient that counts as 100 %, the missions' mean; None for what is given in its own unit."""
    mean = abs(float(np.mean([s.value for s in t.sizes])))
    return None if t.path.startswith("effects.") or mean == 0.0 else mean


def series_json(found: Series) -> dict[str, Any]:
    """The trends as plain data, SI throughout."""
    return {
        "vehicle": found.plant.name,
        "missions": list(found.missions),
        "summary": series_summary(found),
        "trends": [_plain(t) for t in found.trends],
        "failed": dict(found.failed),
    }


def named(item: Changed | Unchanged | Trend) -> str:
    """The title without its remark in brackets."""
    return item.title.partition(" (")[0]


def size_of(size: float, u: Unchanged) -> str:
    """The size of a change; for coefficients, in percent."""
    if u.path.startswith("effects.") or u.value == 0.0:
        return quantity(size, u.unit)
    share = 100.0 * size / abs(u.value)
    return f"{share:.0f} %" if abs(share) >= 100.0 else f"{share:.2g} %"


def _relative(c: Changed) -> str:
    if c.path.startswith("effects.") or c.before.value == 0.0:
        return ""
    return f" or {100.0 * c.change.value / abs(c.before.value):+.2g} %"


def as_json(found: Comparison) -> dict[str, Any]:
    """The comparison as plain data, SI throughout."""
    before, after = found.missions
    return {
        "vehicle": found.plant.name,
        "before": list(before),
        "after": list(after),
        "summary": summary(found),
        "changed": [_plain(c) for c in found.changed],
        "common": [_plain(c) for c in found.common],
        "unchanged": [_plain(u) for u in found.unchanged],
        "candidates": found.candidates,
        "notes": list(found.notes),
    }


def _plain(item: Changed | Common | Unchanged | Timed | Trend) -> dict[str, Any]:
    return finite(asdict(item))
