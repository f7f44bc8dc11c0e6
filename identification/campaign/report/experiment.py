"""The experiment section of the page: set-point tracking, signals of runs, spectra."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from auv_gym.channels import channel, excitation_of, set_point_of
from auv_gym.records.record import Record
from identification.campaign.index import Row
from identification.campaign.report import figures
from identification.campaign.report.focus import DETAILED, representative_runs
from identification.campaign.report.wording import counted, grid_cell_label, percents, run_of, spread, table_has_ranges
from identification.pages.drawn_channels import excited_set_point, inputs_of, outputs_of
from identification.pages.page import Drawing, Table, drawn

SPECTRAL = 60  # most runs that the spectra use


def experiment_heading(rows: Sequence[Row]) -> str:
    """The number of runs, and the outcome of those that did not go as planned."""
    bad = [row for row in rows if not row.usable]
    count, told = counted(len(rows), "run"), {"ended": "ended early"}
    if not bad:
        return f"Experiment: {count}, all finished" if len(rows) > 1 else f"Experiment: {count}, finished"
    states = {status: sum(row.status == status for row in bad) for status in dict.fromkeys(r.status for r in bad)}
    return f"Experiment: {count}, of which " + ", ".join(
        f"{n} {told.get(status, status)}" for status, n in states.items()
    )


def tracking(rows: Sequence[Row], records: Mapping[str, Record]) -> Table | None:
    """Tracking errors, activity of the inputs, and share of time that the guard acted, by cell of the grid."""
    if not rows:
        return None
    first = records[rows[0].id]
    aimed = [n for n in outputs_of(first) if first.has(set_point_of(n))]
    driven = inputs_of(first)
    if not aimed:
        return None
    guarded = any(record.has("envelope_flag") for record in records.values())
    heads = ["setting", "runs"]
    heads += [f"RMS error of {channel(n).label}" for n in aimed]
    heads += [f"RMS of {channel(n).label} about its mean" for n in driven]
    heads += ["guard acted, share of time"] if guarded else []
    lines = []
    for cell in dict.fromkeys(grid_cell_label(row.cell) for row in rows):
        of = [records[row.id] for row in rows if grid_cell_label(row.cell) == cell]
        line: list[str | tuple[str, str]] = [cell or "all runs", str(len(of))]
        line += [_over(of, n, set_point_of(n), lambda r, n=n: _rms(r[n] - excited_set_point(r, n))) for n in aimed]
        line += [_over(of, n, n, lambda r, n=n: float(np.std(r[n]))) for n in driven]
        if guarded:
            line.append(percents([100.0 * float(np.mean(figures.guard_acted(r))) for r in of]))
        lines.append(line)
    excited = any(r.has(excitation_of(n)) for n in aimed for r in records.values())
    caption = f"Error: reading minus set point{' (with its excitation)' * excited}, over whole runs, steps included"
    return Table(
        heads, lines, 1, caption + ("; median over the seeds, and below it the range." * table_has_ranges(lines) or ".")
    )


def experiment_drawings(rows: Sequence[Row], records: Mapping[str, Record], wanted: Sequence[str]) -> list[Drawing]:
    """All runs in one picture if there are many, then a few single runs."""
    if not rows:
        return []
    made = []
    of, cells = [records[row.id] for row in rows], [grid_cell_label(row.cell) for row in rows]
    if len(rows) > DETAILED:
        shown = min(len(of), figures.MOST_LINES)
        which = f"all {len(of)} runs" if shown == len(of) else f"{shown} of the {len(of)} runs, evenly picked"
        caption = f"Outputs of {which}, over one another. Look for one that leaves its bundle."
        label = "Outputs of all runs over time."
        made.append(drawn(lambda: figures.overlay_figure(of, wanted, cells), "overlay", label, caption))
    for count, row in enumerate(representative_runs(rows)):
        record = records[row.id]
        caption = _signals_caption(row, record)
        label = f"Outputs, set points and inputs over time, {run_of(row)}."
        made.append(drawn(lambda r=record: figures.signals_figure(r, wanted), f"signals{count}", label, caption))
    return made


def spectra_heading(rows: Sequence[Row], records: Mapping[str, Record]) -> str:
    """The highest frequency of the spectra, and the number of runs."""
    dt = records[rows[0].id].sample_interval
    return f"Spectra: power up to {np.pi / dt:.2g} rad/s, of {counted(min(len(rows), SPECTRAL), 'run')}"


def spectra_drawing(rows: Sequence[Row], records: Mapping[str, Record], wanted: Sequence[str]) -> Drawing | None:
    """Spectra of outputs and inputs over the runs; None if nothing moves or the records are too short."""
    of = [records[row.id] for row in rows][:SPECTRAL]
    names = [*outputs_of(of[0], wanted), *inputs_of(of[0])] if of else []
    count = max((len(figures.spectra(of, name)[1]) for name in names), default=0)
    if not count:
        return None
    caption = f"Lines: median over {count} runs; bands: their range. " if count > 1 else ""
    caption += (
        "Power densities by Welch's method. Where an output's power falls to a flat floor, noise is all that is left, "
        "and no model can be identified; an input needs power where the vehicle responds."
    )
    label = "Power spectra of outputs and inputs against frequency."
    return drawn(lambda: figures.spectra_figure(of, wanted), "spectra", label, caption)


def _signals_caption(row: Row, record: Record) -> str:
    aimed = any(record.has(set_point_of(name)) for name in outputs_of(record))
    caption = f"{run_of(row)}. Outputs in black" + (" with set points dashed" if aimed else "")
    if inputs_of(record):
        caption += ", inputs in green"
    if any(record.has(excitation_of(name)) for name in inputs_of(record)):
        caption += ", and the excitation in them in ochre"
    if any(record.has(excitation_of(name)) for name in outputs_of(record)):
        caption += "; what excitation adds to a set point is in the dashed line"
    return caption + ("; shaded where the envelope's guard acted." if figures.guard_acted(record).any() else ".")


def _over(records: Sequence[Record], name: str, needed: str, measure: Callable[[Record], float]) -> tuple[str, str]:
    """Median and range of a measure of a channel, over the records that have the channel `needed`."""
    return spread([measure(r) for r in records if r.has(name) and r.has(needed)], name)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))
