"""`auv-gym diagnose`: the physical effects that a vehicle's model is missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from shlex import quote
from time import perf_counter
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from auv_gym.cli.application import app
from auv_gym.cli.options import after_doubt, logs
from auv_gym.cli.options.console import errors, output, progress_bar, table
from auv_gym.cli.options.next_experiment import propose_experiments, tell
from auv_gym.cli.options.numbers import LENGTH, SEED, number, whole_number
from auv_gym.cli.options.outputs import check_output

if TYPE_CHECKING:
    from identification.diagnosis import Diagnosis

_RESULTS = ("diagnosis.json", "vehicle.toml", "report.html", "next_experiment.toml")


@app.command()
def diagnose(
    log: logs.Logs,
    vehicle: logs.Vehicle,
    out: Annotated[Path, typer.Option(help="Folder for diagnosis.json, vehicle.toml and report.html.")],
    min_depth: logs.MinDepth = None,
    max_depth: logs.MaxDepth = None,
    resample: logs.Thinning = None,
    window: Annotated[
        float | None,
        number("Length of the free runs that measure errors, s. Default: the vehicle's own.", *LENGTH),
    ] = None,
    mapping: logs.ColumnNames = None,
    profile: Annotated[
        Path | None,
        typer.Option(
            help="CSV file of water density: density_kgpm3 against depth_m or pressure_dbar, with dive_id if several."
        ),
    ] = None,
    cut_gaps: logs.CutGaps = True,
    doubt: logs.Doubt = 0.1,
    most: Annotated[int, whole_number("Largest number of effects to name.", 1, 20)] = 3,
    trust: logs.Trust = False,
    again: Annotated[
        Path | None,
        typer.Option(
            help="Repeat the diagnosis in this diagnosis.json, with the parameters and settings that it stores. Give "
            "the same log and --vehicle."
        ),
    ] = None,
    timings: Annotated[bool, typer.Option("--timings", help="Print how long each step took.")] = False,
    next_experiment: Annotated[
        bool,
        typer.Option("--next-experiment", help="If effects are tied, write a campaign that tells them apart."),
    ] = False,
    seed: Annotated[
        int,
        whole_number(
            "Random seed, for resampling windows (search for a missing term, location of the remaining error) and for "
            "simulating --next-experiment.",
            *SEED,
        ),
    ] = 0,
    cache_dir: logs.CacheFolder = None,
) -> None:
    """Find the physical effects that a vehicle's model is missing, from a log that disagrees with it."""
    with progress_bar() as progress:
        progress(0.0, "starting")
        # what can be refused at once comes before what takes long to import
        inputs = {"--vehicle": vehicle, "--mapping": mapping, "--profile": profile, "--again": again, "": log}
        check_output("--out", out, inputs, results=_RESULTS)
        logs.refuse_early(vehicle, out, log)

        from auv_gym.records.density import read_profiles, with_density
        from identification.diagnosis import again as diagnose_again, diagnose as diagnose_record, write_diagnosis
        from identification.diagnosis.extras import Extras
        from identification.pages.drawing import require_render

        require_render()

        plant, began = logs.load_stated(vehicle, log[0]), perf_counter()
        progress(0.0, "reading the log")
        record = logs.read_cut(
            log, plant, mapping, cache_dir, cut_gaps, min_depth, max_depth, resample,
            lambda f, text: progress(0.05 * f, text),
        )  # fmt: skip
        if profile is not None:
            if "density_kgpm3" not in plant.inputs:
                raise ValueError(
                    f"--profile is for vehicles whose model uses the water's density; {plant.name} does not: drop it."
                )
            record = with_density(record, read_profiles(profile))
        told = [*record.notes, *logs.tell_remarks(record, plant)]

        read = perf_counter()

        def show(fraction: float, text: str) -> None:
            progress(0.05 + 0.85 * fraction, text)

        if again is not None:
            diagnosis = diagnose_again(again, record, progress=show)
        else:
            diagnosis = diagnose_record(
                record,
                plant,
                window=window,
                seed=seed,
                most=most,
                doubt=doubt,
                trust=trust,
                source=_source(log),
                progress=show,
            )
        progress(0.9, "writing the report")
        diagnosed = perf_counter()
        extras, planned = Extras(), []
        diagnosis = replace(diagnosis, planned=next_experiment)
        written = write_diagnosis(diagnosis, out, extras)
        if next_experiment:
            planned = extras.attempt(
                "The next experiment",
                lambda: propose_experiments(diagnosis, out, lambda fraction, text: progress(0.9, text)),
                None,
            )
            if planned is None:  # the files say so, too
                written = write_diagnosis(diagnosis, out, extras)
        progress(1.0, "done")
    for line in diagnosis.record.notes:
        if line not in told:
            errors.print(f"Log: {escape(line)}", soft_wrap=True)
    output.print()
    for paragraph in diagnosis.paragraphs():
        output.print(paragraph, markup=False)
        output.print()
    output.print(_error_table(diagnosis))
    for loop in diagnosis.loops:
        output.print(loop.words, markup=False)
    if diagnosis.added:
        output.print(_effect_table(diagnosis))
    if planned is not None and next_experiment:
        tell(planned)
    if timings:
        written_in = {"writing the report": perf_counter() - diagnosed}
        output.print(_timings_table({"reading the log": read - began} | dict(diagnosis.seconds) | written_in))
    for failure in (*diagnosis.failures, *extras.failures):
        errors.print(f"[bold yellow]Note:[/] {escape(failure.text)}", soft_wrap=True)
    for path in (*written.values(), *(plan.file for plan in planned or [])):
        output.print(str(path), markup=False, soft_wrap=True)
    if diagnosis.verdict == "doubted":
        same = {"min-depth": min_depth, "max-depth": max_depth, "resample": resample, "window": window}
        options = [f"--{name} {value:g}" for name, value in same.items() if value is not None]
        options += [f"--profile {quote(str(profile))}"] if profile is not None else []
        asked = " ".join([f"--vehicle {quote(vehicle)}", *options, f"--out {quote(str(out))}"])
        following = after_doubt.next_command(diagnosis.doubts, log, mapping, cache_dir, asked)
        output.print(f"Next: {following}", markup=False, soft_wrap=True)


def _source(log: Sequence[str]) -> str:
    """The log in words: its file's name, or the first and how many more."""
    more = f" and {len(log) - 1} more" if len(log) > 1 else ""
    return Path(log[0]).name + more


def _error_table(diagnosis: Diagnosis) -> Table:
    from auv_gym.channels import channel
    from identification.diagnosis.wording import quantity

    stages = diagnosis.stages
    heads = [f"{name}>" for name in stages]
    shown = table(f"RMS error of free runs {diagnosis.reach} in unseen {diagnosis.unseen_words}", "channel", *heads)
    for name in diagnosis.given.scores:
        unit = channel(name).unit
        shown.add_row(name, *(quantity(stage.scores[name].rmse, unit) for stage in stages.values()))
    return shown


def _timings_table(seconds: Mapping[str, float]) -> Table:
    shown = table("Time", "step", "s>")
    for step, time in seconds.items():
        shown.add_row(step, f"{time:.1f}")
    shown.add_row("total", f"{sum(seconds.values()):.1f}")
    return shown


def _effect_table(diagnosis: Diagnosis) -> Table:
    """Each effect, and in the rows below it what it is tied with, with the size that this would have."""
    from auv_gym.param import spec_at
    from identification.diagnosis.wording import interval

    weighed = any(effect.members for effect in diagnosis.added)
    heads = ["effect", "value>", "95 % interval>", *(["probability>"] if weighed else [])]
    shown = table("Effects" if diagnosis.effects else "What the difference acts like", *heads)

    def add(title: str, size: str, limits: str, probability: float | None) -> None:
        odds = "" if probability is None else f"{100.0 * probability:.0f} %"
        shown.add_row(title, size, limits, *([odds] if weighed else []))

    for effect in diagnosis.added:
        told = effect.coefficient or effect  # an effect that does nothing but change a coefficient is told as that
        add(told.title, effect.size, interval(told.ci95, told.unit), effect.probability)
        members = {m.path: m for m in effect.members}
        for path in (path for path in effect.tied_with if path != told.path):
            m = members.get(path)
            title = f"or {spec_at(diagnosis.given.plant, path).title}"
            if m is None:
                add(title, "–", "–", None)
            else:
                add(title, m.size, interval(m.ci95, m.unit), m.probability)
    return shown
