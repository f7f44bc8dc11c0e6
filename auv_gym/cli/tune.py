"""`auv-gym tune`: tune a vehicle's controller, and test it against requirements on all plausible vehicles."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, progress_bar
from auv_gym.cli.options.numbers import SEED, TIME_STEP, number, whole_number
from auv_gym.cli.options.outputs import check_output, is_gains


@app.command()
def tune(
    vehicle: logs.VehicleArgument,
    out: Annotated[Path, typer.Option(help="File of gains to write (.toml); entries for other vehicles are kept.")],
    uncertain: Annotated[
        Path | None,
        typer.Option(
            help="A diagnosis.json or the JSON of a campaign's fit, with values and 95 % intervals. Default: the "
            "deviations in the vehicle file, and 20 % for its other main coefficients."
        ),
    ] = None,
    kind: Annotated[str, typer.Option(metavar="pid|gpc", help="The controller to tune.")] = "pid",
    require: Annotated[
        list[str] | None,
        typer.Option(
            metavar="QUANTITY>=NUMBER",
            help="A requirement in quotes, such as 'phase_margin_deg>=45', or for one loop "
            "'depth_m.overshoot_percent<=10'; may be repeated. Default: sensitivity_peak<=2.",
        ),
    ] = None,
    gains: Annotated[
        Path | None, typer.Option(help="Start from the gains in this file; with --evaluations 0 they are only tested.")
    ] = None,
    evaluations: Annotated[int, whole_number("Evaluations per loop in the search.", 0, 10_000)] = 25,
    draws: Annotated[
        int,
        whole_number("Vehicles drawn from the intervals; half as many corner cases are added.", 0, 10_000),
    ] = 12,
    dt: Annotated[float | None, number("Sample time of the controller, s. Default: the vehicle's.", *TIME_STEP)] = None,
    seed: Annotated[int, whole_number("Random seed.", *SEED)] = 0,
    report: Annotated[Path | None, typer.Option(help="Write a page (.html) with frequency and step responses.")] = None,
) -> None:
    """Tune a vehicle's controller, and test it on vehicles drawn from the uncertainty of its parameters.

    Exit code: 1 if a requirement is not met on all of them; the gains are still written.
    """
    with progress_bar() as progress:
        progress(0.0, "starting")
        from auv_gym.presets import find_vehicle

        # what can be refused at once comes before what takes long to import
        find_vehicle(vehicle)
        inputs = {"VEHICLE": vehicle, "--uncertain": uncertain}
        check_output("--out", out, inputs, ("a file of gains", is_gains))
        if report is not None:
            check_output("--report", report, {**inputs, "--gains": gains, "--out": out})

        from auv_gym.plant import load_vehicle
        from controllers.gains import gains_for, read_gains, with_gains, write_gains
        from controllers.tuning.spread import known_intervals, read_uncertain
        from controllers.tuning.tuning import check_law, tune_and_judge
        from identification.pages.drawing import require_render
        from identification.pages.tuning_page import quantity_tables, requirement_table, tuning_page, tuning_summary

        if report is not None:
            require_render()
        if out.suffix.lower() != ".toml" or not out.parent.is_dir():
            raise ValueError(f"--out needs a name that ends in .toml in an existing folder, got {out}.")
        plant = load_vehicle(vehicle, dt=dt)
        check_law(plant, kind)
        kept = read_gains(out) if out.exists() else ()
        start = None if gains is None else gains_for(plant.name, plant.dt, gains)
        intervals, warnings = known_intervals(plant), ()
        if uncertain is not None:
            plant, intervals, warnings = read_uncertain(plant, uncertain)
        found = tune_and_judge(
            plant,
            kind,
            require,
            intervals,
            seed,
            start=start,
            evaluations=evaluations,
            draws=draws,
            warnings=warnings,
            show=progress,
        )
        write_gains(with_gains(kept, found.gains), out)
        if report is not None:
            from auv_gym.writing import write_text

            progress(1.0, "writing the report")
            write_text(report, tuning_page(found))
    from auv_gym.cli.identify import printed

    output.print()
    for words in tuning_summary(found):
        output.print(words, markup=False, soft_wrap=True)
    output.print(printed("Requirements", requirement_table(found)))
    for shown in quantity_tables(found):
        output.print(printed("Quantities", shown))
    for path in (out, report):
        if path is not None:
            output.print(f"Written to {path}", markup=False, soft_wrap=True)
    if not found.passed:
        raise typer.Exit(1)
