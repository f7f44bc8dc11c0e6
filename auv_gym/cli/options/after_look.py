"""What to type after `auv-gym look`: a diagnosis, a mapping to edit, or what to correct first."""

from __future__ import annotations

from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from auv_gym.cli.options import logs

if TYPE_CHECKING:
    from auv_gym.cli.options.matching import Matches

_MANY_SAMPLES = 6000


def next_command(matches: Matches, log: str, chosen: bool, mapping: Path | None, written: Path | None) -> str:
    """What to type next.  chosen: whether the reader named the one vehicle.  written: the mapping just written."""
    from auv_gym.cli.options.matching import to_type
    from auv_gym.records.clocks import ONE_ZONE, YEAR_FIRST

    found, best, file = matches.found, matches.ranked[0], quote(log)
    if found.is_profile:
        return (
            f"auv-gym diagnose LOG --vehicle NAME --profile {file} --out diagnosis (if this is a density profile: give "
            "it beside a log of the vehicle)"
        )
    options = f" --vehicle {quote(best)}" if chosen else ""
    given = f" --mapping {quote(str(mapping))}" if mapping else ""
    if found.problem.endswith((YEAR_FIRST, ONE_ZONE)):
        return f"write the dates in the file as it says above, then auv-gym look {file}{options}{given}"
    if found.known is None and mapping is not None and written is None:
        return f"correct {quote(str(mapping))} as it says above, then auv-gym look {file}{options}{given}"
    if found.empty:
        return "export the log again, or use another one"
    if found.untimed:
        return (
            "write a column time_s (s) into the file, or name the column that holds time in a mapping (--mapping-out "
            f"names.toml writes one), then auv-gym look {file}{options}{given}"
        )
    if matches.refused:
        return _next_diagnosis(matches, log, written or mapping)
    turned, missing = matches.turned[best], matches.missing(best)
    if not turned and not matches.guessed and found.record is not None:
        return _nothing_fits(matches, log, chosen, given)
    name, where = to_type(matches.best if turned or matches.guessed or chosen else list(matches.needs))
    if written is not None:
        edited = f"edit {quote(str(written))}"
        if not missing:
            edited = (
                f"check in {quote(str(written))} that each output drives the thruster of its number, in its direction"
            )
        command = f"{edited}, then auv-gym look {file} --vehicle {quote(name)} --mapping {quote(str(written))}"
    else:
        new = "names.toml" if mapping is None or mapping.name != "names.toml" else "names_2.toml"
        command = f"auv-gym look {file} --vehicle {quote(name)}{given} --mapping-out {new}"
    return ", ".join(filter(None, [command, where]))


def _nothing_fits(matches: Matches, log: str, chosen: bool, given: str) -> str:
    """What to type where the log has nothing that a vehicle needs; chosen: the one that the reader named."""
    if not chosen:
        return (
            "auv-gym list parts (no preset finds all that it needs in this log: add what is missing to the log, or "
            "write a vehicle file, see docs/guides/add_a_vehicle.md, then run look again with --vehicle FILE; if the "
            "log has only joystick axes, see docs/logs.md)"
        )
    from auv_gym.param import listed

    name = matches.ranked[0]
    missing = matches.missing(name)
    them = "one of them" if len(missing) > 1 else "it"
    joystick = ", or see docs/logs.md if the log has only joystick axes" if matches.thrusters(name) else ""
    return (
        f"auv-gym look {quote(log)}{given} (this compares the log with all vehicles; {name} needs "
        f"{listed(missing)}, which the log does not have. If another column holds {them}, name that column in a "
        f"mapping: see --mapping-out{joystick})"
    )


def _next_diagnosis(matches: Matches, log: str, used: Path | None) -> str:
    """The diagnosis to type next, or what to correct before it."""
    from auv_gym.cli.options.matching import to_type
    from identification.diagnosis.log.checking import RECORD_LONGER

    found, refused = matches.found, matches.refused
    names = quote(str(used or "names.toml"))
    edited = f"correct in {names} what looks wrong"
    if used is None:
        edited = f"auv-gym look {quote(log)} --mapping-out {names}, correct in it what looks wrong"
    fitting = [name for name, why in refused.items() if not why]
    firm = any(("map it to" in doubt or "in a mapping" in doubt) and "unless" not in doubt for doubt in found.doubts)
    spiked = any(doubt.endswith("from the file.") for doubt in found.doubts)
    if not fitting and not firm and not spiked and all(why.endswith(RECORD_LONGER) for why in refused.values()):
        name, where = to_type(list(refused))
        options = f" --vehicle {quote(name)}{f' --mapping {names}' if used else ''} --out diagnosis"
        others = "where MORE are other logs of the same vehicle, since this one alone is too short"
        return ", and ".join(filter(None, [f"auv-gym diagnose {quote(log)} MORE{options}, {others}", where]))
    if not fitting:
        alone = next(iter(refused)) if len(refused) == 1 else "NAME"
        return (
            "first correct what looks wrong, since a diagnosis would refuse this log. If a mapping can correct it: "
            f"{edited}, then auv-gym look {quote(log)} --vehicle {quote(alone)} --mapping {names}. "
            "Otherwise change the file, or use another log or vehicle."
        )
    first = f"{edited}, then " if firm else ""
    options, reasons = f" --mapping {names}" if used or firm else "", []
    if cut := matches.surfacing(fitting):
        options += f" --min-depth {cut:g}"
        reasons.append(
            f"--min-depth {cut:g} leaves out the surface, where the log begins, ends or comes up, and where actuators "
            "act differently"
        )
    record = matches.own[fitting[0]].record
    usual = logs.interval_used(record.sample_interval, matches.plants[fitting[0]].dt) if record else 0.0
    steps = round(record.duration_s / usual) if record else 0
    thinned = _thinned(steps, usual)
    if thinned:
        options += f" --resample {thinned:g}"
        reasons.append(f"without --resample its {steps + 1:,} samples every {short(usual)} s take long")
    why = f" ({'; '.join(reasons)})" if reasons else ""
    name, where = to_type(fitting)
    command = f"{first}auv-gym diagnose {quote(log)} --vehicle {quote(name)}{options} --out diagnosis{why}"
    return ", ".join(filter(None, [command, where]))


def short(seconds: float) -> str:
    """Seconds to three digits, without an exponent."""
    return f"{seconds:.0f}" if seconds >= 1000.0 else f"{seconds:.3g}"


def _thinned(steps: int, interval: float) -> float | None:
    """A round sample time, s, longer than the interval, with which many steps become no more than take minutes."""
    if steps <= _MANY_SAMPLES:
        return None
    rounded = (step * 10.0**power for power in range(-3, 6) for step in (1.0, 2.0, 5.0))
    return next((s for s in rounded if s > interval and steps * interval / s <= _MANY_SAMPLES), None)
