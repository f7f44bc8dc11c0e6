"""A log replayed through a monitor: its alarms, their cause, and the report."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym import __version__
from auv_gym.channels import channel
from auv_gym.param import spec_at
from auv_gym.records.record import Record
from auv_gym.writing import finite, writable_folder, write_text
from identification.changes.onset import Timeline
from identification.changes.wording import timeline_json, timeline_summary
from identification.diagnosis.search.trials import Progress
from identification.monitor.monitor import CONSTANT, SCATTER, Alarm, Monitor
from identification.pages.drawing import AFTER, BEFORE, WIDTH
from identification.pages.model_page import Section
from identification.pages.page import Table, drawn, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_POINTS = 1000  # points of the picture, each the greatest value in its span of time
_TOLD, _LISTED = 3, 20  # alarms in the summary, and in the table of the page
_SIGNALS = {CONSTANT: "none (steady offset)", SCATTER: "none (larger errors)"}


@dataclass(frozen=True, eq=False)
class Watched:
    """The result of watching a log with a monitor.

    clean: name of the log that the monitor learned from.  hours: length of the log.  time: (n,) s, and over: (n,), the
    greatest statistic over its bar.  timeline: of the data around the first alarm, None without an alarm; problem: why
    there is none despite an alarm.
    """

    monitor: Monitor
    clean: str
    hours: float
    alarms: tuple[Alarm, ...]
    time: np.ndarray
    over: np.ndarray
    timeline: Timeline | None = None
    problem: str = ""

    @property
    def apart(self) -> float:
        """The time after which an alarm counts as a new one, s: the longest memory of the tests."""
        return float(self.monitor.learned.memories.max() * self.monitor.learned.interval)

    @property
    def episodes(self) -> list[list[Alarm]]:
        """The alarms, grouped if they follow one another within `apart`: a lasting fault repeats its alarm."""
        found: list[list[Alarm]] = []
        for alarm in self.alarms:
            if found and alarm.time - found[-1][-1].time < self.apart:
                found[-1].append(alarm)
            else:
                found.append([alarm])
        return found


def watch(
    monitor: Monitor,
    record: Record,
    *,
    clean: str = "the clean log",
    trust: bool = False,
    progress: Progress = lambda fraction, text: None,
) -> Watched:
    """Replay a log, and find the cause from the data around the first alarm.

    clean: the report's name for the log that the monitor learned from.
    """
    found = [(monitor.time, monitor.over, alarm) for alarm in monitor.replay(record)]
    alarms = tuple(alarm for _, _, alarm in found if alarm is not None)
    timeline, problem = None, ""
    if alarms:
        try:
            timeline = monitor.explain(record, alarms[0], trust=trust, progress=progress)
        except ValueError as error:
            problem = str(error)
    time, over = (np.array([row[k] for row in found]) for k in (0, 1))
    return Watched(monitor, clean, record.duration_s / 3600.0, alarms, time, over, timeline, problem)


def alarm_words(alarms: Sequence[Alarm]) -> str:
    """`Alarm at 412 s: the heading departs steadily from its prediction (over the last 50 s).`, and its end."""
    alarm = alarms[0]
    what = f"the {channel(alarm.channel).label}" if alarm.channel else "several readings together"
    verb = "departs" if alarm.channel else "depart"
    if alarm.signal == SCATTER:
        text = f"the prediction errors of {what} have grown"
    elif alarm.signal == CONSTANT:
        text = f"{what} {verb} steadily from the prediction"
    else:
        text = f"{what} {verb} from the prediction, in proportion to the {channel(alarm.signal).label}"
    text = f"Alarm at {alarm.time:.0f} s: {text} (over the last {alarm.memory:.0f} s)."
    return text + (f" It is repeated until {alarms[-1].time:.0f} s." if len(alarms) > 1 else "")


def learned_words(found: Watched) -> str:
    """Which log the monitor learned from, and whether that log itself shows a fault."""
    learned = found.monitor.learned
    hours = len(learned.clean) * learned.interval / 3600.0
    text = f"The monitor assumes that the vehicle in {found.clean} ({hours:.2g} h) was healthy."
    if learned.missing:
        names = " or ".join(dict.fromkeys(spec_at(learned.plant, path).title for path in learned.missing))
        text += (
            f" But that log itself shows a fault: {names}. A fault of that kind and size raises no alarm. Diagnose "
            "that log first, or take another one (--clean)."
        )
    return text


def watched_summary(found: Watched) -> list[str]:
    """What the monitor learned from, the alarms, and the cause, one sentence each."""
    rate, episodes, hours = found.monitor.false_alarms_per_hour, found.episodes, found.hours
    lines = [learned_words(found)]
    if not episodes:
        return [*lines, f"No alarm was raised in {hours:.2g} h, with the false-alarm rate set to {rate:g} per hour."]
    lines += [alarm_words(alarms) for alarms in episodes[:_TOLD]]
    if len(episodes) > _TOLD:
        left = len(episodes) - _TOLD
        follow = "1 more alarm follows" if left == 1 else f"{left} more alarms follow"
        lines.append(f"{follow}, the last one at {episodes[-1][0].time:.0f} s.")
    lines.append(
        f"The false-alarm rate is set to {rate:g} per hour: expect {rate * hours:.2g} false alarms in {hours:.2g} h."
    )
    if found.timeline is None:
        return [*lines, f"The log around the first alarm could not be diagnosed. {found.problem}"]
    return [*lines, "Around the first alarm, the diagnosis found:", *timeline_summary(found.timeline)]


def watched_json(found: Watched) -> dict[str, Any]:
    """The result as plain data, SI throughout."""
    return finite(
        {
            "vehicle": found.monitor.learned.plant.name,
            "summary": watched_summary(found),
            "clean": {"log": found.clean, "missing": list(found.monitor.learned.missing)},
            "false_alarms_per_hour": found.monitor.false_alarms_per_hour,
            "alarms": [asdict(alarm) for alarm in found.alarms],
            "timeline": None if found.timeline is None else timeline_json(found.timeline),
        }
    )


def write_watched(found: Watched, folder: str | os.PathLike) -> dict[str, Path]:
    """Write monitor.json and monitor.html; returns their paths by name.

    Raises ValueError if the folder cannot be written, ImportError without the extra `render`.
    """
    out = writable_folder(folder)
    texts = {"monitor.json": json.dumps(watched_json(found), indent=2) + "\n", "monitor.html": watched_page(found)}
    for name, text in texts.items():
        write_text(out / name, text)
    return {name: out / name for name in texts}


def watched_page(found: Watched) -> str:
    """The report as the text of one HTML page, with one picture."""
    count = len(found.episodes)
    rows = [_row(alarms) for alarms in found.episodes]
    about = [
        f"After an alarm the tests restart, so that a fault that stays raises more of them. Those that follow one "
        f"another within {found.apart:.0f} s share a row, which has the first one's cause; all are in monitor.json. "
        "The statistic is the largest one, relative to its threshold."
    ]
    if len(rows) > _LISTED:
        about.append(f"These are the first {_LISTED} rows of {len(rows)}.")
    heads = ("time", "repeated", "reading", "correlates with", "tested over the last", "statistic / threshold")
    picture = drawn(
        lambda: watched_figure(found),
        "monitor",
        "Largest test statistic relative to its threshold, over time, with the alarms.",
        "The largest test statistic, relative to its threshold. At 1 an alarm is raised (triangle) and the tests "
        "restart; the band lasts as long as the alarm is repeated.",
    )
    content: dict[str, Any] = {
        "title": f"{found.monitor.learned.plant.name}: {count} alarm{'' if count == 1 else 's'}",
        "eyebrow": f"false-alarm rate set to {found.monitor.false_alarms_per_hour:g} per hour",
        "found": watched_summary(found),
        "sections": [
            Section("Tests over time", (), (), [picture]),
            *([Section("Alarms", about, [Table(heads, rows[:_LISTED], words=4)], ())] if rows else []),
        ],
        "version": __version__,
    }
    return page("models.html", content)


def _row(alarms: Sequence[Alarm]) -> tuple[str, ...]:
    """The table row of an alarm and its repetitions."""
    first, last = alarms[0], alarms[-1]
    return (
        f"{first.time:.0f}{f' to {last.time:.0f}' if len(alarms) > 1 else ''} s",
        f"{len(alarms) - 1} times" if len(alarms) > 1 else "–",
        channel(first.channel).label if first.channel else "several",
        _SIGNALS[first.signal] if first.signal in _SIGNALS else channel(first.signal).label,
        f"{first.memory:.0f} s",
        f"{max(alarm.over for alarm in alarms):.2f}",
    )


def watched_figure(found: Watched) -> Figure:
    """The greatest statistic over its bar, against time."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 2.6), layout="constrained")
    axes = figure.add_subplot()
    pieces: Sequence[np.ndarray] = np.array_split(np.arange(found.time.size), min(_POINTS, max(found.time.size, 1)))
    axes.plot(
        [found.time[p[0]] for p in pieces if p.size], [found.over[p].max() for p in pieces if p.size], color=AFTER
    )
    axes.axhline(1.0, color=BEFORE, linewidth=0.8, linestyle="--")
    for alarms in found.episodes:
        axes.axvspan(alarms[0].time, alarms[-1].time, color=BEFORE, alpha=0.15, linewidth=0.0)
        axes.plot(alarms[0].time, alarms[0].over, "v", color=BEFORE)
    axes.set_xlabel("time, s")
    axes.set_ylabel("statistic / threshold")
    axes.set_ylim(bottom=0.0)
    return figure
