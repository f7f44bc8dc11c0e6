"""What to type after a diagnosis that doubts the log: a mapping that corrects it, and the diagnosis with it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from auv_gym.records.mapping import Source
    from identification.diagnosis.log.plausibility import Doubt
    from identification.diagnosis.log.slips import Slip


def next_command(
    doubts: Sequence[Doubt], logs: Sequence[str], mapping: Path | None, cache_dir: Path | None, options: str
) -> str:
    """What to type next.  options: those of the diagnosis, without its mapping."""
    files = " ".join(map(quote, logs))
    slips = [doubt for doubt in doubts if doubt.slip is not None]
    if not slips:
        return f"auv-gym look {quote(logs[0])} (this compares the log with all vehicles, and lists what looks wrong)"
    lines = _lines([doubt.slip for doubt in slips if doubt.slip is not None], logs[0], mapping, cache_dir)
    given = f" --mapping {quote(str(mapping))}" if mapping else ""
    if not lines:
        mends = "; ".join(doubt.mend for doubt in slips)
        return f"in the file, {mends}, then auv-gym diagnose {files}{given} {options}"
    names = quote(str(mapping or "names.toml"))
    edited = f"in {names}, change the lines of these columns to" if mapping else f"write into {names}:"
    return f"{edited} {' and '.join(lines)}; then auv-gym diagnose {files} --mapping {names} {options}"


def _lines(slips: Sequence[Slip], log: str, mapping: Path | None, cache_dir: Path | None) -> list[str]:
    """Lines of a mapping that undo all slips, by the columns of the log; none where a mapping cannot."""
    from auv_gym.records.first_look import look_at

    known = look_at(log, mapping, cache_dir).known
    if known is None:
        return []
    used = {name: of[0] for name, of in known.by_channel.items() if name not in known.derived}
    found = [_undoing(slip, used) for slip in slips]
    return list(dict.fromkeys(line for lines in found for line in lines)) if all(found) else []


def _undoing(slip: Slip, used: Mapping[str, Source]) -> list[str]:
    """The lines that undo one slip, if it is certain how.  used: the column that each channel is taken from."""
    from auv_gym.records.first_look import corrected

    if slip.clock != 1.0 or not all(name in used for name in slip.channels):
        return []
    if slip.exchanged:
        return [corrected(used[name], other) for name, other in zip(slip.channels, reversed(slip.channels))]
    if not slip.factors:
        return []
    pairs = zip(slip.channels, slip.factors, strict=True)
    return [corrected(used[name], name, factor, slip.offset) for name, factor in pairs]
