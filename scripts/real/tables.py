"""The content of the page about measured logs: tables, lines for the README, and the picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from identification.diagnosis.wording import interval, quantity
from scripts.real.log import Error, Log
from scripts.studies.harness import Sheet

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Said = Mapping[str, Any]
Results = Sequence[tuple[Log, Said]]

_STAGES = ("as given>", "refitted>", "with effects>", "others>")
_COLOURS = ("#8a97a3", "#d55e00", "#0072b2", "#009e73")
_WIDE = 30.0  # least ratio of the largest error to the smallest for a logarithmic axis
_OF_SAMPLES = (" of the log is ", "is assumed", "were dropped")
_UNITS = {
    "deg": "angles: RMS error of free runs, deg",
    "m": "depth: RMS error of free runs, m",
    "cm/s": "vertical velocity: RMS error, cm/s",
    "%": "speeds and rates: RMS error of free runs, % of the signal's deviation",
}

_SEVERAL = ("deg", "%")  # units of several signals


def sheets(results: Results) -> list[Sheet]:
    """The tables of the page."""
    heads = (
        "log",
        "signal",
        *_STAGES,
        "verdict",
        "effects named (95 % interval), share of the halves of the log that choose them",
    )
    found = [
        Sheet("real_logs", "Errors on unseen data, and the effects that were found", heads, [_row(*r) for r in results])
    ]
    told: dict[tuple[str, str, str], list[str]] = {}
    for log, _ in results:
        told.setdefault((log.source, log.known, log.rival or "no other tool known"), []).append(log.name)
    heads = ("logs", "source", "what is known from other sources", "others")
    rows = [["; ".join(names), *words] for words, names in told.items()]
    found.append(Sheet("sources", "Sources of the logs", heads, rows))
    if rows := [_constants(log, said["constants"]) for log, said in results if "constants" in said]:
        heads = ("log", "constant", "in the file>", "refitted, 95 % interval>")
        found.append(Sheet("constants", "Constants of the Seagliders' flight model", heads, rows))
    dives = [dive for _, said in results for dive in said.get("currents", ())]
    if dives:
        heads = ("dive", "with the operators' constants>", "with effects, 95 % intervals>", "stated by the operators>")
        rows = [[d["dive"], *(_current(d[k]) for k in ("given", "after", "operators"))] for d in dives]
        found.append(
            Sheet("currents", "Depth-averaged currents of unseen dives, m/s north and east", heads, sorted(rows))
        )
    return found


def left_out(results: Results) -> list[str]:
    """A line for each log about samples left out or assumed; notes on its columns are not repeated."""
    lines = []
    for log, said in results:
        notes = [n for n in dict.fromkeys(said["log_notes"]) if any(words in n for words in _OF_SAMPLES)]
        if notes:
            lines.append(f"- {log.name}: {' '.join(notes)}")
    return lines


def summary(results: Results) -> list[str]:
    """The results in brief, for the README: the first signal of each log."""
    rows = []
    for log, said in results:
        first = log.errors(said)[0]
        given, refitted, effects, others = _numbers(first)
        rows.append([log.name, f"{first.signal}, {first.unit}", given, refitted, effects, others, _verdict(said)])
    return Sheet("", "", ("log", "error", *_STAGES, "verdict"), rows).markdown().splitlines()[2:]


def figure(results: Results) -> Figure:
    """Bars of the errors, a panel for each unit; on a logarithmic axis if they differ too much for a linear one."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    of = {unit: [] for unit in _UNITS}
    for log, said in results:
        for error in log.errors(said):
            if error.unit in of:
                of[error.unit].append((log.name, error))
    of = {unit: bars for unit, bars in of.items() if bars}
    drawn = Figure(figsize=(9.6, 0.36 * sum(len(bars) + 2 for bars in of.values())), layout="constrained")
    panels = drawn.subplots(len(of), 1, height_ratios=[len(bars) + 1 for bars in of.values()], squeeze=False)[:, 0]
    for panel, (unit, bars) in zip(panels, of.items(), strict=True):
        for k, (label, colour) in enumerate(zip(("as given", "refitted", "with effects", "best of others"), _COLOURS)):
            sizes = [(*error.stages, error.others)[k] for _, error in bars]
            at = np.arange(len(bars)) + 0.2 * (k - 1.5)
            panel.barh(at, [np.nan if s is None else s for s in sizes], 0.19, color=colour, label=label)
        names = [f"{name}: {error.signal}" if unit in _SEVERAL else name for name, error in bars]
        panel.set(yticks=np.arange(len(bars)), yticklabels=names, title=_UNITS[unit])
        sizes = [size for _, e in bars for size in (*e.stages, e.others) if size]
        if max(sizes) > _WIDE * min(sizes):
            panel.set_xscale("log")
            panel.xaxis.set(
                major_locator=LogLocator(subs=(1.0, 2.0, 5.0)), major_formatter=FuncFormatter(lambda x, _: f"{x:g}")
            )
            panel.xaxis.set_minor_formatter(NullFormatter())
        panel.invert_yaxis()
        panel.grid(visible=False, axis="y")
    panels[0].legend(ncols=4, loc="lower left", bbox_to_anchor=(0.0, 1.12))
    return drawn


def _row(log: Log, said: Said) -> list[str]:
    errors = log.errors(said)
    columns = [f"{e.signal}, {e.unit}" for e in errors], *zip(*map(_with_intervals, errors), strict=True)
    return [log.name, *("<br>".join(cells) for cells in columns), _verdict(said), "; ".join(named(said)) or "nothing"]


def _numbers(error: Error) -> list[str]:
    values = [*error.stages, error.others]
    return ["-" if value is None or not np.isfinite(value) else f"{value:.3g}" for value in values]


def _with_intervals(error: Error) -> list[str]:
    limits = [*error.intervals, *[None] * 4][:4]
    words = [f" ({ends[0]:.3g} to {ends[1]:.3g})" if ends else "" for ends in limits]
    return [number + more for number, more in zip(_numbers(error), words, strict=True)]


def _constants(log: Log, constants: Sequence[Said]) -> list[str]:
    """A row of the operators' constants, a line each: stated or assumed, and refitted or not."""
    given = [_size(c["given"]) + ("" if c["stated"] else " (not there: assumed)") for c in constants]
    fitted = [
        "not freed" if c["value"] is None else f"{_size(c['value'])} ({' to '.join(map(_size, c['ci95']))})"
        for c in constants
    ]
    return [log.name, *("<br>".join(lines) for lines in ([c["name"] for c in constants], given, fitted))]


def _size(value: float) -> str:
    """A constant to three digits; a volume in cm³ to a tenth."""
    return f"{value:.1f}" if abs(value) > 1e3 else f"{value:.3g}"


def _verdict(said: Said) -> str:
    return said["verdict"] + (", something left" if said["unexplained"] and said["verdict"] != "unexplained" else "")


def named(said: Said) -> list[str]:
    """The effects of a result, named or not, with size, interval and frequency, and their ties.

    Terms found in the data are included.
    """
    groups = {path: [p for p in group if p != path] for group in said["tied"] for path in group}
    names = []
    for e in (*said["effects"], *said.get("acts_like", ())):
        told = e.get("coefficient") or e
        low, high = (np.nan if limit is None else limit for limit in told["ci95"])
        size = f"{quantity(told['value'], told['unit'])} ({interval((low, high), told['unit'])})"
        share = "" if e["frequency"] is None else f", {100.0 * e['frequency']:.0f} %"
        names.append(
            ("" if e in said["effects"] else "acts like ")
            + f"`{told['path']}` {size}{share}"
            + "".join(f", or `{p}`" for p in groups.get(e["path"]) or e.get("tied_with") or () if p != told["path"])
        )
    found = said.get("discovered") or {}
    terms = found["terms"] if found.get("holds") else ()
    return [*names, *(f"no effect, but {t['words']}, {100.0 * t['frequency']:.0f} %" for t in terms)]


def _current(found: Sequence[Any]) -> str:
    """A current, or each of several, in m/s north and east, with 95 % intervals where standard errors follow."""
    several = [found] if found and not isinstance(found[0], list | tuple) else found
    return "; ".join(_both_ways(*one) for one in several) or "-"


def _both_ways(north: float, east: float, *errors: float) -> str:
    reach = [f" ± {1.96 * error:.3f}" for error in errors] or ["", ""]
    return f"{north:.3f}{reach[0]}, {east:.3f}{reach[1]}"
