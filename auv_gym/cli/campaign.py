"""`auv-gym campaign`: run the experiments of a campaign file, fit models to them, and write the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from enum import StrEnum
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from auv_gym.cli.application import app
from auv_gym.cli.options.choices import choice
from auv_gym.cli.options.console import errors, output, progress_bar, table
from auv_gym.cli.options.numbers import SEED, whole_number

if TYPE_CHECKING:
    from identification.campaign.file.settings import Campaign
    from identification.campaign.running.conduct import Conducted

_LISTED = 20  # failed runs in the table; the index has all


class Part(StrEnum):
    """The parts of a campaign that can be done by themselves."""

    runs = "runs"
    fits = "fits"
    gains = "gains"
    report = "report"


@app.command()
def campaign(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A campaign file (.toml), see docs/campaigns.md.")],
    out: Annotated[
        Path, typer.Option(help="Folder for records, index, models and report; an existing campaign is resumed.")
    ],
    jobs: Annotated[int | None, whole_number("Worker processes. Default: one per core.", 1, 1024)] = None,
    scheduler: Annotated[
        str | None, typer.Option(help="Address of a Dask scheduler for the runs, such as tcp://host:8786.")
    ] = None,
    seed: Annotated[int, whole_number("Added to every seed in the file.", *SEED)] = 0,
    only: Annotated[Part | None, choice(Part, "Run only this part. Default: all parts.")] = None,
) -> None:
    """Run a campaign: experiments, fits, comparison and gains; a stopped campaign is resumed.

    Exit codes: 3 if a run, fit or comparison failed or gains miss a requirement; 130 if the campaign was stopped.
    """
    with progress_bar() as progress:
        progress(0.0, "starting")
        from joblib import cpu_count

        from identification.campaign.file.reading import read_campaign
        from identification.campaign.running.conduct import conduct

        settings = read_campaign(file, seed)
        jobs = cpu_count() if jobs is None else jobs
        failed, fits, rollouts = False, [], []
        for part, needed, given in ((Part.fits, "[[fit]]", settings.fit), (Part.gains, "[tune]", settings.tune)):
            if only is part and not given:
                raise ValueError(f"--only {part.value} needs {needed} in {file}, which has none: add one.")
        try:
            if only in (None, Part.runs):
                conducted = conduct(settings, out, jobs=jobs, scheduler=scheduler, progress=_counted(progress))
            else:
                conducted = None
            if only in (None, Part.fits) and settings.fit:
                from identification.campaign.fits import fit_models

                fits = fit_models(settings, out, jobs=jobs, progress=progress)
                failed |= any(fit["status"] != "done" for fit in fits)
                if settings.compare is not None:
                    from identification.campaign.rollouts import compare_rollouts

                    rollouts = compare_rollouts(settings, out, jobs=jobs, progress=progress)
                    failed |= any(told["status"] == "failed" for told in rollouts)
            told: list[str] = []
            if only in (None, Part.gains) and settings.tune is not None:
                from identification.campaign.gains import tune_fitted

                passed, told = tune_fitted(settings, out, progress)
                failed |= not passed
            report = None
            if only in (None, Part.report):
                progress(1.0, "writing the report")
                report = _report(settings, out, needed=only is Part.report)
        except KeyboardInterrupt:
            errors.print(f"Stopped. Finished work is in {out}; the same command resumes it.", soft_wrap=True)
            raise typer.Exit(130) from None
    if conducted is not None:
        _tell(conducted, out)
        failed |= bool(conducted.failures or conducted.trouble)
    _tell_failed("fits", {fit["name"]: fit for fit in fits})
    _tell_failed("comparisons", {f"{one['kind']} loop of run {one['run']}": one for one in rollouts})
    for words in told:
        output.print(words, markup=False, soft_wrap=True)
    if report is not None:
        output.print(str(report), markup=False, soft_wrap=True)
    if failed:
        raise typer.Exit(3)


def _counted(progress: Callable[[float, str], None]) -> Callable[[int, int, int, str], None]:
    """What turns counts of runs into a bar with words: how many, how many failed, and the time that is left."""
    begin: list[tuple[float, int]] = []

    def tell(done: int, total: int, failed: int, text: str) -> None:
        words = f"{done} of {total} runs" if text == "running" else text
        if text == "running":
            begin[:] = begin or [(monotonic(), done)]
            here = done - begin[0][1]
            if here and done < total:
                left = (monotonic() - begin[0][0]) / here * (total - done)
                words += f", {left:.0f} s left" if left < 120.0 else f", {left / 60.0:.0f} min left"
        progress(done / max(total, 1), words + (f", {failed} failed" if failed else ""))

    return tell


def _report(settings: Campaign, out: Path, *, needed: bool) -> Path | None:
    """The written report; without the extra it needs, a word about that, unless nothing else was asked for."""
    from identification.campaign.report import write_report

    try:
        return write_report(settings, out)
    except ImportError as error:
        if needed:
            raise
        errors.print(f"No report: {error}", markup=False, soft_wrap=True)
        return None


def _tell(conducted: Conducted, out: Path) -> None:
    rows = conducted.rows
    done = sum(row.usable for row in rows)
    kept = f", {conducted.kept} of them earlier" if conducted.kept else ""
    output.print(f"{done} of {len(rows)} runs done in {out}{kept}.", markup=False, soft_wrap=True)
    if conducted.strangers:
        output.print(
            f"{len(conducted.strangers)} records in {out} belong to no run of this campaign file, which has changed: "
            "delete them if you do not need them.",
            markup=False,
            soft_wrap=True,
        )
    if conducted.failures:
        output.print(_failures(conducted))
    if conducted.trouble:
        errors.print(f"The index is not up to date: {conducted.trouble}", markup=False, soft_wrap=True)


def _tell_failed(what: str, results: Mapping[str, Mapping[str, Any]]) -> None:
    """Say which of these results, by name, failed and why."""
    reasons = {name: result["reason"] for name, result in results.items() if result["status"] != "done"}
    if reasons:
        shown = table(f"{len(reasons)} of {len(results)} {what} failed", "name!", "reason")
        for name, reason in reasons.items():
            shown.add_row(name, reason)
        output.print(shown)


def _failures(conducted: Conducted) -> Table:
    failures = conducted.failures
    more = f", the first {_LISTED}" if len(failures) > _LISTED else ""
    shown = table(f"{len(failures)} runs did not go as planned{more}", "run!", "status", "seed>", "grid", "reason")
    for row in failures[:_LISTED]:
        cell = ", ".join(f"{key} = {value}" for key, value in row.cell.items())
        shown.add_row(row.id, row.status, str(row.seed), cell, row.reason)
    return shown
