"""The gains of a campaign: `[tune]` for the vehicle found by one of its fits, over the intervals of that fit."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from auv_gym.channels import channel
from auv_gym.param import listed
from auv_gym.plant import Plant
from auv_gym.writing import write_json, write_text
from controllers.gains import write_gains
from controllers.tuning.spread import read_uncertain
from controllers.tuning.tuning import Judged, tune_and_judge
from identification.campaign.file.settings import Campaign
from identification.campaign.fits import FOLDER, load_fitted, read_fits
from identification.campaign.running.shelf import Progress
from identification.pages.page import percent

GAINS, RESULT, PAGE = "gains.toml", "tuning.json", "tuning.html"
_FILE = "Gains: "


def tune_fitted(campaign: Campaign, folder: str | Path, progress: Progress) -> tuple[bool, list[str]]:
    """Write gains.toml, tuning.json and tuning.html; returns whether all requirements are met, and a summary.

    Gains for the same settings and the same fit are not tuned again.  Without the fit, the summary gives the reason.
    """
    folder, asked = Path(folder), campaign.tune
    assert asked is not None  # checked by the caller
    fit = next((fit for fit in read_fits(folder) if fit["fit"] == asked.fit), None)
    if fit is None or fit["status"] != "done":
        return False, [f"No gains: the fit {asked.fit!r} is not done ({fit['reason'] if fit else 'run the fits'})."]
    model = load_fitted(folder, fit)
    if not isinstance(model, Plant):
        return False, [f"No gains: {asked.fit!r} is a model by {fit['method']}, and gains are of a vehicle: grey_box."]
    key = hashlib.sha256(json.dumps([asked.model_dump(mode="json"), fit["key"]]).encode()).hexdigest()
    kept = _kept(folder, key)
    if kept is not None:
        return kept
    plant, intervals, warnings = read_uncertain(model, folder / FOLDER / f"{fit['name']}.json")
    found = tune_and_judge(
        plant,
        asked.kind,
        asked.require,
        intervals,
        asked.seed,
        evaluations=asked.evaluations,
        draws=asked.draws,
        warnings=warnings,
        show=progress,
    )
    write_gains((found.gains,), folder / GAINS)
    words = []
    try:
        from identification.pages.tuning_page import tuning_page, tuning_summary

        words = [*tuning_summary(found), *_held_out(fit, found), f"{_FILE}{folder / GAINS}"]
        write_text(folder / PAGE, tuning_page(found))
    except ImportError as error:
        words.append(f"No page: {error}")
    write_json(folder / RESULT, {"key": key, "passed": found.passed, "found": words})
    return found.passed, words


def _held_out(fit: Mapping[str, Any], found: Judged) -> list[str]:
    """How well the fit predicts the controlled channels, in runs that it was not fitted to."""
    from identification.campaign.report.models import median_fit_percents  # imported here, as it imports this module

    reached = median_fit_percents(fit)
    told = [f"{percent(reached[name])} in {channel(name).label}" for name in found.loops if name in reached]
    return [f"On held-out runs, the fit of {fit['fit']!r} is {listed(told)}."] if told else []


def read_tuned(folder: str | Path) -> list[str]:
    """The summary of a campaign's tuning, without its files; empty if nothing has been tuned."""
    try:
        found = json.loads((Path(folder) / RESULT).read_text(encoding="utf-8"))["found"]
        return [str(words) for words in found if not words.startswith(_FILE)]
    except (OSError, ValueError, KeyError, TypeError):
        return []


def _kept(folder: Path, key: str) -> tuple[bool, list[str]] | None:
    """The result of an earlier call for the same fit, if its gains still exist."""
    try:
        told = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        return (told["passed"], told["found"]) if told["key"] == key and (folder / GAINS).is_file() else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
