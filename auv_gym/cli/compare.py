"""`auv-gym compare`: compare models over records."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from auv_gym.cli.application import app
from auv_gym.cli.identify import printed
from auv_gym.cli.options import logs
from auv_gym.cli.options.console import output, progress_bar
from auv_gym.cli.options.numbers import LENGTH, number, whole_number

if TYPE_CHECKING:
    from auv_gym.model import Model
    from auv_gym.records.record import Record


@app.command()
def compare(
    models: Annotated[
        list[str], typer.Argument(metavar="MODEL", help="Model files (.npz), vehicle files (.toml) or presets.")
    ],
    record: Annotated[list[str], typer.Option(metavar="LOG", help="A record to compare over; may be repeated.")],
    out: Annotated[
        Path | None, typer.Option(help="Folder for report.html and scores.json; created if it does not exist.")
    ] = None,
    resample: logs.Resample = None,
    window: Annotated[
        float | None, number("Length of the free runs, s. Default: whole segments, or a vehicle's own.", *LENGTH)
    ] = None,
    settle: Annotated[
        float | None, number("First seconds of each window, used to fit its start and not scored.", 0, LENGTH[1])
    ] = None,
    horizon: Annotated[
        list[int] | None,
        whole_number("Prediction horizon in samples; may be repeated. Default: 1 to 100.", 1, 1_000_000),
    ] = None,
    mapping: logs.ColumnNames = None,
    cut_gaps: logs.CutGaps = True,
) -> None:
    """Compare models over records, by free runs from fitted starts and by predictions over several horizons."""
    with progress_bar() as progress:
        progress(0.0, "starting")
        logs.check_log_files(record)  # refused before what takes long to import

        from auv_gym.model import Diverged
        from auv_gym.models.files import load_model
        from identification.compare.comparison import compare_open
        from identification.compare.model_tests import sweep_horizons
        from identification.identified import joined
        from identification.pages.drawing import require_render
        from identification.pages.model_page import compared_page, horizon_table, score_table

        if out is not None:
            require_render()
        loaded = dict(zip(_names(models), (load_model(path) for path in models), strict=True))
        data = joined([logs.read_log(name, mapping, None, (), cut_gaps) for name in record])
        data = data if resample is None else data.resample(resample)
        _check_sample_times(loaded, data)
        progress(0.1, "free runs")
        open_loop = compare_open(loaded, data, window=window, settle=settle)
        sweeps: dict[str, dict[str, dict[float, float]]] = {}
        for number, (name, model) in enumerate(loaded.items()):
            progress(0.4 + 0.4 * number / len(loaded), f"predictions of {name}")
            if name in open_loop.runs:
                try:
                    swept = sweep_horizons(model, data, open_loop.settle, horizon or ())
                except Diverged as error:
                    open_loop.failed[name] = str(error)
                    continue
                sweeps |= {name: swept} if swept else {}
        written: list[Path] = []
        files = ", ".join(Path(name).name for name in record)
        words = (
            f"{len(loaded)} model{'s' * (len(loaded) != 1)} over {files}: {len(data)} samples, {data.duration_s:g} s."
        )
        if out is not None:
            progress(0.9, "writing")
            page = compared_page(f"Models over {files}", open_loop, sweeps, words)
            scores = {m: {c: s.as_dict() for c, s in of.items()} for m, of in open_loop.scores.items()}
            result = {"settle_s": open_loop.settle, "scores": scores, "horizons_s": sweeps, "failed": open_loop.failed}
            written = _write(out, {"report.html": page, "scores.json": json.dumps(result, indent=1) + "\n"})
        progress(1.0, "done")
    output.print()
    output.print(words, markup=False, soft_wrap=True)
    title = f"Free runs in {len(open_loop.windows)} windows, starts fitted to the first {open_loop.settle:g} s"
    if open_loop.runs:
        output.print(printed(title, score_table(open_loop)))
    if sweeps:
        uneven = "" if data.is_uniform() else " (approximate: samples are uneven)"
        output.print(printed(f"RMS prediction error, by horizon{uneven}", horizon_table(sweeps)))
    for name, reason in open_loop.failed.items():
        output.print(f"{name}: {reason}", markup=False, soft_wrap=True)
    for path in written:
        output.print(f"Written to {path}", markup=False, soft_wrap=True)


def _names(models: list[str]) -> list[str]:
    """The stems of the files; whole paths where two have the same."""
    stems = [Path(path).stem for path in models]
    if len(set(models)) != len(models):
        raise ValueError(f"A model is listed twice in {', '.join(models)}: name each once.")
    return [stem if stems.count(stem) == 1 else path for stem, path in zip(stems, models, strict=True)]


def _check_sample_times(models: Mapping[str, Model], data: Record) -> None:
    """Raises, by their names, if models in discrete time do not step as the record is sampled."""
    from auv_gym.model import Continuous

    times: dict[str, float] = {name: model.dt for name, model in models.items() if not isinstance(model, Continuous)}
    if len({round(dt, 9) for dt in times.values()}) > 1:
        told = ", ".join(f"{name} {dt:g} s" for name, dt in times.items())
        raise ValueError(
            f"Models with different sample times cannot be compared over one record: {told}. Fit them at one interval, "
            "for example with `auv-gym identify --resample`."
        )
    for name, dt in times.items():
        if not data.is_uniform() or abs(dt - data.sample_interval) > 1e-3 * dt:
            raise ValueError(
                f"{name} has a time step of {dt:g} s, but the record has samples {data.sample_interval:g} s apart"
                f"{'' if data.is_uniform() else ', unevenly'}: give --resample {dt:g}."
            )


def _write(folder: Path, files: Mapping[str, str]) -> list[Path]:
    from auv_gym.writing import write_text

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"Cannot make the folder {folder}: {error.strerror or error}.") from error
    for name, text in files.items():
        write_text(folder / name, text)
    return [folder / name for name in files]
