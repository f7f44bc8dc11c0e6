"""Reading records from files of any known format: mapping to channels, completing, and merging on one time base."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from auv_gym.channels import SEGMENT_COLUMNS, channel, conversion, is_flag, set_point_of
from auv_gym.param import listed
from auv_gym.records.completing import hydrography
from auv_gym.records.formats import check_file, format_of
from auv_gym.records.gliding import glide_speed
from auv_gym.records.joining import check_apart, labelled, labels_of, one_after_the_other, side_by_side
from auv_gym.records.log import Empty, Format, Log, Scope
from auv_gym.records.mapping import MappingLike, Names, guessed, list_of, load_mapping, sources
from auv_gym.records.merging import merged
from auv_gym.records.mermaid import is_mermaid, mermaid_dives
from auv_gym.records.naming import looks_like
from auv_gym.records.readers.slocum import bundled_slocum_log
from auv_gym.records.readers.text import CSV
from auv_gym.records.record import Record, check_gap
from auv_gym.records.understanding import NO_VALUE, Needs, Understood, joined_labels, understood

_OF_PLACE = ("latitude_rad", "longitude_rad", "magnetic_variation_rad")  # only used while a log is read
_FEW = 5  # reasons listed in an error
_SAMPLE = 50  # rows per group, enough to see which columns a slow format has


def read_record(
    path: str | Path | Sequence[str | Path],
    mapping: MappingLike = None,
    required: Iterable[str] | Needs = (),
    *,
    max_gap_s: float | None = None,
    long_runs: Literal["cut", "raise"] = "cut",
    beside: str | Path | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Record:
    """Read a record from a file of any supported format, from several files, or from an example log (slocum:ammonite).

    mapping: from their column to our channel or to '' (left out), as a dict or the path of a flat TOML file; '*' means
    all other columns.  A target's suffix is the column's unit: {"Hdg": "heading_deg"} gives heading_rad.  A minus
    changes the sign, {"fin": "-rudder_rad"}; a table scales and shifts, {"d": {"to": "depth_m", "factor": 0.1}}; a
    number is a constant that was not logged, {"speed_cmd_kn": 3.0}.  Columns that it does not name are identified by
    the mappings shipped for common sources, or by their own name and unit.
    required: channels that must exist, the leading one first, or the `Needs` of a vehicle.  Other channels are left out
    if they would cost more than a tenth of the samples; `record.notes` says so, a line each.
    max_gap_s: see Record.split_gaps.  long_runs: see Record.from_arrays.  beside: a folder of files that a log needs.
    Columns segment, dive_id and run divide the file, and so do several files; these must be of one vehicle and must not
    repeat data.  Times above 1e8 s, and dates, become s since the first (attribute `start_epoch_s`).
    Raises ValueError for anything that cannot be read or does not fit.

    Example:

        >>> from pathlib import Path
        >>> from auv_gym import read_record
        >>> size = Path("log.csv").write_text("t,Hdg,fin\\n0,10,1\\n1,11,1\\n2,13,-1\\n")
        >>> log = read_record("log.csv", {"t": "time_s", "Hdg": "heading_deg", "fin": "-rudder_deg"})
        >>> log["heading_rad"].round(3)
        array([0.175, 0.192, 0.227])
    """
    if not isinstance(path, Iterable | Path):
        raise ValueError(f"read_record needs the path of a log, or a list of paths, got {path!r}.")
    check_gap(max_gap_s)
    needs = required if isinstance(required, Needs) else Needs(tuple(required))
    paths = [path] if isinstance(path, (str, Path)) else list(path)
    if not paths:
        raise ValueError("read_record needs the path of a log, or of several, got none.")
    names = load_mapping(mapping)
    told = progress or (lambda fraction, text: None)
    beside = None if beside is None else Path(beside)
    found = []
    for number, file in enumerate(map(find_log, paths)):
        if is_saved_record(file) and not names.targets and not names.constants:
            found.append((file, _saved(file, needs, max_gap_s)))
        else:
            found.append((file, _read_one(file, names, beside, partial(_share, told, number, len(paths)))))
    records, logs = [], side_by_side(found)
    labels = labels_of([(file, "" if isinstance(one, Record) else one.label) for file, one in logs])
    for (file, one), label in zip(logs, labels, strict=True):
        if isinstance(one, Record):
            records.append((file, labelled(one, label) if len(paths) > 1 else one))
            continue
        try:
            record = assembled(understood(one, names, needs), needs, max_gap_s, long_runs)
        except ValueError as error:
            raise _named(file, error) from error
        records.append((file, labelled(record, label) if len(paths) > 1 else record))
    check_apart([(str(file), record) for file, record in records])
    return one_after_the_other([record for _, record in records])


def _share(told: Callable[[float, str], None], number: int, count: int, fraction: float, text: str) -> None:
    """Report the progress of one of several files as part of the whole."""
    told((number + fraction) / count, text)


def open_log(path: Path, scope: Scope | None = None) -> Log:
    """The log in a file as its reader returns it; raises ValueError, with the path, if it cannot be read."""
    return _read_as(format_of(path), path, scope or Scope())


def find_log(name: str | Path) -> Path:
    """The file of a log, or of one that dbdreader ships (`slocum:ammonite`); raises ValueError if it cannot be read.

    Example:

        >>> from auv_gym import find_log
        >>> find_log("slocum:ammonite").name
        'ammonite-2008-028-01-000.mbd'
    """
    text = str(name)
    if re.match(r"(https?|ftp|s3):/", text):
        raise ValueError(f"{text} is an address, not a file: download it first, and give the path of the file.")
    path = bundled_slocum_log(text.removeprefix("slocum:")) if text.startswith("slocum:") else Path(text)
    check_file(path)
    format_of(path)
    return path


def read_columns(path: str | Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The columns of a CSV file that is not a time series, in our units, and a label for each row ('' if none)."""
    path = find_log(path)
    try:
        group = CSV.read(path, Scope()).groups[0]
        labels = joined_labels([group.columns[name] for name in SEGMENT_COLUMNS if name in group.columns])
        numbers: dict[str, np.ndarray] = {}
        for name, column in group.columns.items():
            if isinstance(column, np.ndarray) and not is_flag(name):
                target, convert = conversion(name)
                numbers[target.name] = convert(column)
        return numbers, np.full(len(next(iter(group.columns.values()))), "") if labels is None else labels
    except ValueError as error:
        raise _named(path, error) from error


def _saved(path: Path, needs: Needs, max_gap_s: float | None) -> Record:
    record = Record.load(path).split_gaps(max_gap_s)
    for name in needs.required:
        record[name]
    return record


def _read_one(path: Path, names: Names, beside: Path | None, progress: Callable[[float, str], None]) -> Log:
    """The log in a file; for a slow format, only the groups that will be used."""
    found = format_of(path)
    if not found.slow:
        return _read_as(found, path, Scope(beside=beside, progress=progress))
    first = _read_as(found, path, Scope(most=_SAMPLE, beside=beside))
    try:
        wanted = {source.group.name for source in sources(first, names)[0]}
    except ValueError as error:
        raise _named(path, error) from error
    return _read_as(found, path, Scope(groups=wanted, beside=beside, progress=progress)) if wanted else first


def _read_as(found: Format, path: Path, scope: Scope) -> Log:
    """The log in a file of this format; raises ValueError with the path, whatever its reader raises."""
    try:
        return found.read(path, scope)
    except ValueError as error:
        raise _named(path, error) from error
    except (ImportError, MemoryError):
        raise
    except Exception as error:  # an error of another package's reader, or of a library that fails on a damaged file
        raise ValueError(
            f"{path} could not be read as {found.name} ({error!r}): it may be damaged, copy or export it again."
        ) from error


def assembled(
    known: Understood, needs: Needs, max_gap_s: float | None = None, long_runs: Literal["cut", "raise"] = "cut"
) -> Record:
    """The record of a log whose columns are known."""
    source, notes = known.log.source, [*known.notes]
    for stream in known.streams:
        if is_mermaid(stream.values):  # its readings are minutes or hours apart, and none of these intervals is a gap
            labels = np.zeros(stream.time.size) if stream.labels is None else stream.labels
            dives = mermaid_dives(stream.time, stream.values, labels, source)
            return dives.with_notes([*notes, *dives.notes])
    if not known.streams:
        raise _without_channels(known)
    leading = next((name for name in needs.required if any(name in s.values for s in known.streams)), None)
    joined = merged(known.streams, leading)
    notes += joined.notes
    values = dict(joined.values)
    derived = dict(known.derived)
    for name, value in known.constants.items():
        if name not in _OF_PLACE:
            values[name] = np.full(joined.time.size, value)
    for name, found in hydrography(values, known.streams, known.constants, notes).items():
        values[name], derived[name] = found, "the CTD, by TEOS-10"
    for name in needs.required:
        commanded = command_for(name)
        if name not in values and commanded in values:
            values[name], derived[name] = values[commanded], f"{commanded}, since it is not measured"
    glides = known.glides or needs.attack is not None
    if glides and "u_mps" not in values and {"depth_m", "pitch_rad"} <= set(values):
        speed = np.full(joined.time.size, np.nan)
        for rows in _runs(joined.segment, joined.time.size):  # each has its own clock
            found = glide_speed(joined.time[rows], values["depth_m"][rows], values["pitch_rad"][rows], needs.attack)
            speed[rows] = np.nan if found is None else found
        if np.isfinite(speed).any():
            values["u_mps"] = speed
            less = " less the angle of attack" if needs.attack is not None else ""
            derived["u_mps"] = f"depth rate over sine of pitch{less}, both averaged over 30 s"
    missing = [name for name in needs.required if name not in values]
    if missing:
        raise _missing(missing, known)
    attrs: dict[str, Any] = {"source": source, "format": known.log.format, **known.log.attrs}
    if known.epoch is not None:
        attrs["start_epoch_s"] = known.epoch
    if derived:
        attrs["derived"] = "; ".join(f"{name}: {words}" for name, words in derived.items())
    kept = needs.required or (joined.leading,)
    record = Record.from_arrays(
        joined.time, values, joined.segment, attrs, long_runs=long_runs, required=kept, notes=notes,
        unread=joined.unread, spare=needs.spare,
    )  # fmt: skip
    record = record.with_intervals({n: s for n, s in joined.intervals.items() if record.has(n)})
    cut = record.split_gaps(max_gap_s)
    gaps = len(cut.segments) - len(record.segments)
    line = f"The record is cut at {gaps} gap{'s' * (gaps != 1)} in time."
    return cut.with_notes([*cut.notes, line]) if gaps else cut


def _runs(segment: np.ndarray | None, size: int) -> list[slice]:
    """The rows of each segment, in order."""
    if segment is None or size == 0:
        return [slice(0, size)]
    edges = np.flatnonzero(segment[1:] != segment[:-1]) + 1
    return [slice(int(a), int(b)) for a, b in pairwise([0, *edges, size])]


def _missing(missing: Sequence[str], known: Understood) -> ValueError:
    """The error for required channels that the log does not have, with columns that look like them."""
    hints = ""
    for name in missing:
        hints += looks_like(name, [c for group in known.log.groups for c in group.columns if guessed(group, c, name)])
    have = list_of(sorted({name for stream in known.streams for name in stream.values}))
    needed = " and ".join(missing) if len(missing) < 3 else ", ".join(missing)
    example = f'"their column" = "{missing[0]}"'
    one, inputs = len(missing) == 1, [name for name in missing if channel(name).kind == "input"]
    lack = f"no channel {needed}, which is needed" if one else f"no channels {needed}, which are needed"
    state = ""
    if inputs:  # a measurement has to move
        as_constant = "as a constant" if len(inputs) == 1 else "as constants"
        state = f", or state {('it' if one else 'them') if inputs == missing else listed(inputs)} {as_constant}"
    return ValueError(
        f"The log has {lack}; it has {have}. {hints}Name {'it' if one else 'them'} in a mapping, as in {example}"
        f"{state}; `auv-gym look` shows all columns."
    )


def _reasons(known: Understood) -> str:
    """The reasons why columns of a log were left out; if there are many, the first few."""
    if not known.notes:
        return f"It has {list_of(known.log.names)}. "
    more = len(known.notes) - _FEW
    return " ".join(known.notes[:_FEW]) + (f" And {more} more. " if more > 0 else " ")


def _without_channels(known: Understood) -> ValueError:
    """The error for a log without channels: a mapping cannot help if its columns are empty."""
    text = f"No column of the log could be read as a channel besides its time. {_reasons(known)}"
    if known.notes and all(note.endswith(NO_VALUE) for note in known.notes):
        return Empty(f"{text}Its columns are empty: export the log again, or use another one.")
    return ValueError(f'{text}Name them in a mapping, as in "Hdg" = "heading_deg".')


def command_for(name: str) -> str:
    """The channel of the command that can replace an unmeasured input; '' if it is not an input."""
    return set_point_of(name) if channel(name).kind == "input" and "_cmd" not in name else ""


def is_saved_record(path: Path) -> bool:
    """Whether a file was written by Record.save."""
    if not path.is_file():  # a ROS 2 bag is a folder
        return False
    with path.open("rb") as file:
        if file.read(8) != b"\x89HDF\r\n\x1a\n":
            return False
    import h5py

    try:
        with h5py.File(path, "r") as content:
            return "segment_labels" in content.attrs and "time_s" in content
    except Exception:  # a damaged file may raise almost anything; its reader reports it
        return False


def _named(path: Path, error: ValueError) -> ValueError:
    return error if str(path) in str(error) else ValueError(f"{path}: {error}")
