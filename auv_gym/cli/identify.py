"""`auv-gym identify`: fit a model to records, test it on held-out data, and write it to a file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from auv_gym.cli.application import app
from auv_gym.cli.options import logs, orders
from auv_gym.cli.options.console import output, progress_bar, table
from auv_gym.cli.options.numbers import LENGTH, number
from auv_gym.cli.options.outputs import begins_with, check_output, is_vehicle

if TYPE_CHECKING:
    from rich.table import Table as Printed

    from auv_gym.records.record import Record
    from identification.pages.page import Table

_KINDS = {
    ".toml": ("a vehicle file", is_vehicle),
    ".npz": ("a model file", begins_with(b"PK\x03\x04", b"PK\x05\x06")),
}


@app.command()
def identify(
    records: Annotated[list[str], typer.Argument(metavar="LOG", help="Logs of any format that `auv-gym look` reads.")],
    method: Annotated[str, typer.Option(help="A method, see `auv-gym list methods`.")],
    out: Annotated[Path, typer.Option(help="Model file to write: .npz, or .toml for a vehicle.")],
    vehicle: Annotated[
        str | None,
        typer.Option(help="With grey_box: a preset (see `auv-gym list vehicles`) or a vehicle file."),
    ] = None,
    inputs: Annotated[
        list[str] | None, typer.Option("--input", metavar="CHANNEL", help="An input of the model; may be repeated.")
    ] = None,
    outputs: Annotated[
        list[str] | None, typer.Option("--output", metavar="CHANNEL", help="An output of the model; may be repeated.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="A setting of the method, such as n_a=3; may be repeated."),
    ] = None,
    search: orders.Search = None,
    choose: orders.Choose = None,
    tolerance: orders.Tolerance = None,
    free: Annotated[
        list[str] | None,
        typer.Option(metavar="PATH", help="With grey_box: a parameter to fit, such as hull.n_r; may be repeated."),
    ] = None,
    validate: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LOG", help="A record to test on; may be repeated. Default: the last third of each record."
        ),
    ] = None,
    resample: logs.Resample = None,
    window: Annotated[
        float | None, number("Length of the free runs, s. Default: whole segments; for a vehicle, its own.", *LENGTH)
    ] = None,
    mapping: logs.ColumnNames = None,
    cut_gaps: logs.CutGaps = True,
    report: Annotated[
        Path | None, typer.Option(help="Write a page with tables and figures to this .html file or folder.")
    ] = None,
) -> None:
    """Fit a model to records, test it by free runs over held-out data, and write it to a file."""
    from auv_gym.presets import find_vehicle

    with progress_bar() as progress:
        progress(0.0, "starting")
        # what can be refused at once comes before what takes long to import
        if vehicle is not None:
            find_vehicle(vehicle)
        logs.check_log_files([*records, *(validate or [])])
        files = {"": records, "--validate": validate, "--vehicle": vehicle, "--mapping": mapping}
        check_output("--out", out, files, _KINDS.get(out.suffix.lower()))
        if report is not None:
            check_report("--report", report)
            check_output("--report", report, {**files, "--out": out}, results=("report.html",) * is_folder(report))

        from auv_gym.models.files import save_model
        from auv_gym.plant import load_vehicle
        from auv_gym.records.joining import check_apart
        from identification.estimator import make_estimator, notes_of, parse_settings
        from identification.identified import identify as identify_records
        from identification.linear.fit import is_linear
        from identification.linear.poles import pole_intervals
        from identification.pages.drawing import require_render
        from identification.pages.linear_tables import order_table, pole_table
        from identification.pages.model_page import (
            horizon_table,
            identified_page,
            outside_words,
            parameter_table,
            residual_table,
            score_table,
        )

        if report is not None:
            require_render()
        plant = None if vehicle is None else load_vehicle(vehicle)
        given = parse_settings(settings or [])
        if free:
            if "free" in given:
                raise ValueError("--free and --set free=... mean the same: give one of them.")
            given["free"] = list(free)
        ranges = orders.check(search, choose, tolerance)
        estimator = make_estimator(method, given, plant=plant, inputs=inputs, outputs=outputs)
        # what is written is known only after the fit, but a wrong name should not cost one
        _check_name(out, ".toml" if type(estimator).__name__ == "GreyBox" else ".npz")
        progress(0.02, "reading")
        named = [*(inputs or []), *(outputs or [])]
        fitted, apart = (
            [_read(name, mapping, named, cut_gaps, resample) for name in names] for names in (records, validate or [])
        )
        check_apart(list(zip([*records, *(validate or [])], [*fitted, *apart], strict=True)))
        found, fitting = None, progress
        if ranges:
            from identification.linear.polynomials.orders import TOLERANCE
            from identification.order_search import search_apart

            found = search_apart(
                method,
                fitted,
                apart,
                inputs,
                outputs,
                ranges,
                settings=given,
                criterion=choose or "mdl",
                tolerance=TOLERANCE if tolerance is None else tolerance,
                progress=_part(progress, 0.02, 0.7),
            )
            estimator, fitting = found.estimator(), _part(progress, 0.7, 1.0)
        done = identify_records(estimator, fitted, apart, window=window, search=found, progress=fitting)
        model = done.fit.model
        chosen = {} if found is None else found.choice().settings()
        attrs: dict[str, Any] = {
            "method": method,
            "settings": {**given, **chosen},
            "records": [Path(name).name for name in records],
            "judged_on": [Path(name).name for name in validate or []] or done.told,
        }
        if found is not None:
            attrs["order_search"] = {"criterion": found.criterion, "tolerance": found.tolerance, "tried": ranges}
        save_model(model, out, attrs)
        page = None
        if report is not None:
            progress(0.9, "writing the report")
            page = report / "report.html" if is_folder(report) else report
            title = method if out.stem == method else f"{out.stem} ({method})"
            _write_page(page, identified_page(title, done, _words(method, done.fitted, records)))
        progress(1.0, "done")
    output.print()
    output.print(_words(method, done.fitted, records), markup=False, soft_wrap=True)
    for doubt in done.doubts:
        output.print(f"Check the data: {doubt}", markup=False, soft_wrap=True)
    output.print()
    if found is not None:
        shown = order_table(found)
        output.print(printed("Orders", shown))
        output.print(shown.caption, markup=False, soft_wrap=True)
        output.print()
    parameters = parameter_table(done.fit.estimates)
    for note in notes_of(done.fit):
        output.print(f"{note[0].upper()}{note[1:]}.", markup=False, soft_wrap=True)
    if parameters.rows:
        output.print(printed("Parameters", parameters))
    if parameters.caption:
        output.print(f"{parameters.caption}\n", markup=False, soft_wrap=True)
    if is_linear(done.fit):
        output.print(printed("Poles, in discrete time", pole_table(pole_intervals(done.fit))))
    if done.open_loop is not None and done.open_loop.runs:
        settle = f"starts fitted to the first {done.open_loop.settle:g} s"
        output.print(printed(f"Free runs over {done.told}, {settle}", score_table(done.open_loop)))
    for words in outside_words(done):
        output.print(words, soft_wrap=True)
    if done.sweep:
        output.print(printed("RMS prediction error, by horizon", horizon_table({"model": done.sweep})))
    if done.tests:
        output.print(
            printed(
                "Residual tests (strongest input: relative to the 95 % noise bound)",
                residual_table(done.tests),
            )
        )
    if done.problem:
        output.print(f"Not tested in full: {done.problem}", markup=False, soft_wrap=True)
    for path in (out, page):
        if path is not None:
            output.print(f"Written to {path}", markup=False, soft_wrap=True)


def printed(title: str, shown: Table) -> Printed:
    """A table of texts as the console prints it."""
    from rich.markup import escape

    heads = (head + (">" if i >= shown.words else "!") for i, head in enumerate(shown.heads))
    result = table(title, *heads)
    for row in shown.rows:
        result.add_row(*(escape(str(cell)) for cell in row))  # a1[depth_m] is no style
    return result


def _part(progress: Callable[[float, str], Any], first: float, last: float) -> Callable[[float, str], Any]:
    """The progress of a part of the work, from one fraction of all to another."""
    return lambda fraction, text: progress(first + fraction * (last - first), text)


def _read(name: str, mapping: Path | None, required: Sequence[str], cut_gaps: bool, resample: float | None) -> Record:
    record = logs.read_log(name, mapping, None, required, cut_gaps)
    return record if resample is None else record.resample(resample)


def _check_name(out: Path, suffix: str) -> None:
    if out.suffix.lower() != suffix:
        raise ValueError(f"--out needs a name that ends in {suffix} for this method, got {out.name!r}.")


def is_folder(report: Path) -> bool:
    """Whether a report is to be written into a folder of this name, rather than to a file."""
    return report.suffix.lower() != ".html"


def check_report(option: str, report: Path) -> None:
    """Raise ValueError, before any work, if a page cannot be written to this file or folder."""
    from auv_gym.writing import writable_folder

    if report.suffix.lower() == ".htm":
        raise ValueError(f"{option} needs a name that ends in .html, or a folder, got {report.name!r}.")
    if not is_folder(report) and report.is_dir():
        raise ValueError(f"{option} {report} is a folder: give a file in it, such as {report / 'report.html'}.")
    if is_folder(report):
        writable_folder(report)


def _write_page(path: Path, text: str) -> None:
    from auv_gym.writing import write_text

    path.parent.mkdir(parents=True, exist_ok=True)
    write_text(path, text)


def _words(method: str, fitted: Record, names: Sequence[str]) -> str:
    files = ", ".join(Path(name).name for name in names)
    parts = len(fitted.segments)
    segments = f" in {parts} segments" if parts > 1 else ""
    return f"{method}, fitted to {len(fitted)} samples, {fitted.duration_s:g} s{segments}, of {files}."
