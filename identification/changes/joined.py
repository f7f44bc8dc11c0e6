"""The logs of one vehicle before and after, joined into one checked log in which every part has a share of both."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from auv_gym.model import elapsed_over_gaps
from auv_gym.plant import Plant
from auv_gym.records.record import Record, concat
from identification.changes.forms import refuse_overlaps, usable_log
from identification.diagnosis.log.checking import Asked, CheckedLog
from identification.diagnosis.log.parts import Part


def joined_sides(sides: Mapping[str, Record], plant: Plant, asked: Asked) -> tuple[CheckedLog, int]:
    """The logs before and after, joined in this order, and the row at which the second begins.

    Each log is checked by itself.  Every part has the same share of both, so that each part can be predicted from the
    others on both sides of a change.  Channels that only one log has are left out.
    Raises ValueError, with the side's name, if a log cannot be used or looks mislabelled, or if the logs overlap.
    """
    refuse_overlaps(sides)
    checked = [usable_log(record, plant, asked, name) for name, record in sides.items()]
    timed = [_timed(log.record, plant) for log in checked]
    common = set.intersection(*(set(record.names) for record in timed))
    alone = sorted({n for record in timed for n in record.names} - common)
    records = [record.without([n for n in record.names if n not in common]) for record in timed]
    record = concat(records)
    if alone:
        line = f"Only one side has {', '.join(alone)}: left out of the comparison."
        record = record.with_notes([*record.notes, line])
    begins = np.cumsum([0, *(len(r) for r in records)]).tolist()
    joined = CheckedLog(
        record,
        plant,
        asked,
        _together([log.parts for log in checked], begins),
        _together([log.windows for log in checked], begins),
        min(log.window for log in checked),
        min(log.settle for log in checked),
        all(log.steady for log in checked),
        tuple(d for log in checked for d in log.doubts),
        tuple(dict.fromkeys(n for log in checked for n in log.left_out)),
    )
    return joined, begins[1]


def _timed(record: Record, plant: Plant) -> Record:
    """A side's record with its own elapsed time, so that the time does not continue from the other side."""
    if "elapsed_s" not in plant.inputs or record.has("elapsed_s"):
        return record
    return record.with_channels({"elapsed_s": elapsed_over_gaps(record)})


def _together(parts: Sequence[Sequence[Part]], begins: Sequence[int]) -> tuple[Part, ...]:
    """The first parts of all sides as one part, then the second ones, as rows of the joined record."""
    found: list[list[slice]] = [[] for _ in range(max(len(own) for own in parts))]
    for own, begin in zip(parts, begins, strict=False):
        for k, part in enumerate(own):
            found[k] += [slice(w.start + begin, w.stop + begin) for w in part]
    return tuple(tuple(part) for part in found)
