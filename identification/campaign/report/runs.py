"""The table of all runs on the page of a campaign."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from auv_gym.records.record import Record
from identification.campaign.index import Row
from identification.campaign.report.wording import duration, grid_cell_label, left_out
from identification.pages.page import Table

MOST_ROWS = 300


def runs_heading(rows: Sequence[Row]) -> str:
    """The number of runs that went as planned."""
    return f"All runs: {sum(row.usable for row in rows)} of {len(rows)} went as planned"


def runs_table(rows: Sequence[Row], records: Mapping[str, Record]) -> Table:
    """Each run with status and reason; runs that did not go as planned are marked."""
    lines = []
    for row in rows[:MOST_ROWS]:
        record = records.get(row.id)
        status = f"{row.status}: {row.reason}" if row.reason else row.status
        size = (f"{len(record):,}", duration(record.duration_s)) if record else ("–", "–")
        lines.append((row.id, status, grid_cell_label(row.cell) or "–", str(row.seed), *size))
    marked = [count for count, row in enumerate(rows[:MOST_ROWS]) if not row.usable]
    caption = left_out(len(rows) - MOST_ROWS, "further runs: in index.csv.")
    return Table(("run", "status", "setting", "seed", "samples", "length"), lines, 3, caption, marked)
