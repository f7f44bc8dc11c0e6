"""The page of a campaign: what was run, what was identified, and how well the models replace the vehicle.

One module per section: setup and experiment, models, loops (rollouts), residuals, runs; wording and focus serve all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from auv_gym.records.record import Record
from auv_gym.writing import write_text
from identification.campaign.file.plan import plan
from identification.campaign.file.settings import Campaign
from identification.campaign.fits import read_fits
from identification.campaign.gains import read_tuned
from identification.campaign.index import Row, read_index
from identification.campaign.report.experiment import (
    experiment_drawings,
    experiment_heading,
    spectra_drawing,
    spectra_heading,
    tracking,
)
from identification.campaign.report.focus import fit_limited_to_outputs, outputs_in_question
from identification.campaign.report.loops import loop_content
from identification.campaign.report.models import model_content, models_heading, score_table
from identification.campaign.report.residuals import residual_content
from identification.campaign.report.runs import runs_heading, runs_table
from identification.campaign.report.setup import setup
from identification.campaign.report.wording import counted, duration, grid_cell_label, left_out, median
from identification.campaign.rollouts import read_rollouts
from identification.pages.drawing import require_render
from identification.pages.page import page, percent

MOST_MODELS = 6  # shown with their parameters
GLOSSARY = {
    "free run": "The model alone, driven by the inputs from one starting state, never looking at the outputs again.",
    "held out": "Runs that no fit has used. Errors there show what a model is worth on data that it has not seen.",
    "fit": "100 (1 − |error| / |output less its mean|) %: 100 % is perfect, 0 % no better than a constant.",
    "open loop": "The model gets the inputs that the vehicle got.",
    "closed loop": "The model stands in the vehicle's place, and the same controller steers it by its own outputs.",
    "step": "The largest change that the set point asks for in a run; without one, the range of the output.",
    "RMS": "Root mean square.",
    "residual": "Measured minus model.",
    "white": "Without memory: knowing one sample of the residual says nothing about the next.",
    "95 % interval": "Where the parameter lies with 95 % confidence, if the model's form is right.",
}


def write_report(campaign: Campaign, folder: str | Path) -> Path:
    """Write `report.html` into a campaign's folder, self-contained, with fits and rollouts if there are any.

    Raises ImportError, with the command to run, if the extra `render` is not installed.
    """
    require_render()
    folder = Path(folder)
    content = _content(campaign, folder, read_index(folder))
    path = folder / "report.html"
    write_text(path, page("campaign.html", content))
    return path


def _content(campaign: Campaign, folder: Path, rows: Sequence[Row]) -> dict[str, Any]:
    usable = [row for row in rows if row.finished and row.path(folder).is_file()]
    records = {row.id: Record.load(row.path(folder)) for row in usable}
    fits, rollouts = read_fits(folder), read_rollouts(folder)
    wanted = outputs_in_question(fits, list(records.values()))
    fits = [fit_limited_to_outputs(fit, wanted) for fit in fits]
    made = [fit for fit in fits if fit["status"] == "done"]
    told = {kind: loop_content(kind, rollouts[kind], rows, folder, wanted) for kind in ("open", "closed")}
    residuals = residual_content(made)
    whole = [row for row in usable if row.usable] or usable  # the shortest run limits the resolution of the spectra
    spectra = spectra_drawing(whole, records, wanted)
    headings = {
        "experiment": experiment_heading(rows),
        "spectra": spectra_heading(whole, records) if spectra else "",
        "models": models_heading(fits) if fits else "",
        **{kind: of["heading"] if of else "" for kind, of in told.items()},
        "residuals": residuals["heading"] if residuals else "",
        "runs": runs_heading(rows),
        "method": "How it was done",
    }
    links = {
        "experiment": "Experiment",
        "spectra": "Spectra",
        "models": "Models",
        "open": "Open loop",
        "closed": "Closed loop",
        "residuals": "Residuals",
        "runs": "All runs",
        "method": headings["method"],
    }
    found = [headings[key] for key in ("experiment", "models", "open", "closed", "residuals") if headings[key]]
    tuned = read_tuned(folder) if campaign.tune is not None else []
    remarks = [f"{fit['name']} failed: {fit['reason']}" for fit in fits if fit["status"] != "done"]
    remarks += [f"{fit['name']}: {remark}" for fit in made for remark in fit["remarks"]]
    return {
        "name": campaign.name,
        "description": campaign.description,
        "found": found,
        "warned": any(not row.usable for row in rows)
        or bool(remarks)
        or any(of and of["complaints"] for of in told.values()),
        "tuned": tuned,
        "cards": _cards(rows, records, fits, rollouts),
        "sections": [(f"{key}-loop" if key in told else key, title) for key, title in links.items() if headings[key]],
        "headings": headings,
        "setup": setup(plan(campaign)[0].settings, campaign.folder, rows, records),
        "tracking": tracking(usable, records),
        "experiment": experiment_drawings(usable, records, wanted),
        "spectra": spectra,
        "scores": score_table(made),
        "remarks": remarks,
        "models": [model_content(fit) for fit in made[:MOST_MODELS]],
        "models_left_out": left_out(len(made) - MOST_MODELS, "further models: parameters in their JSON files."),
        "rollouts": told,
        "residuals": residuals,
        "runs": runs_table(rows, records),
        "glossary": GLOSSARY,
        "versions": next((str(r.attrs["versions"]) for r in records.values() if r.attrs.get("versions")), ""),
        "settings": campaign.text,
    }


def _cards(
    rows: Sequence[Row],
    records: Mapping[str, Record],
    fits: Sequence[Mapping[str, Any]],
    rollouts: Mapping[str, Sequence[Mapping[str, Any]]],
) -> list[tuple[str, str, str]]:
    """The key numbers, each with words, a value and a remark."""
    cells = len({grid_cell_label(row.cell) for row in rows})
    where = f"in {cells} cells of the grid" if cells > 1 else "with one setting"
    seconds = sum(record.duration_s for record in records.values())
    cards = [
        ("runs with a record", f"{len(records)} / {len(rows)}", where),
        ("time in the records", duration(seconds), "all runs together"),
    ]
    done = [fit for fit in fits if fit["status"] == "done"]
    if fits:
        held = {run for fit in done for run in fit["scores"]}
        cards.append(("models fitted", f"{len(done)} / {len(fits)}", f"judged on {counted(len(held), 'held-out run')}"))
    names = {fit["name"] for fit in done}
    for kind, words in (("closed", "closed loop"), ("open", "open loop")):
        models = [of for r in rollouts[kind] for name, of in r["models"].items() if name in names]
        errors = [s["percent"] for of in models for s in of["scores"].values()]
        if errors:
            return [
                *cards,
                (f"models in {words}", percent(median(errors)), "RMS error, in percent of the step; median"),
            ]
    return cards
