"""The files that a diagnosis leaves: diagnosis.json, vehicle.toml and report.html."""

from __future__ import annotations

import json
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.param import list_paths, spec_at, value_at
from auv_gym.plant import save_vehicle
from auv_gym.writing import replacing
from identification.diagnosis.verdict import Diagnosis, Stage

SIMILAR = 60.0  # degrees between signatures below which the angle is told


def write_diagnosis(diagnosis: Diagnosis, folder: str | os.PathLike) -> dict[str, Path]:
    """Write the three files into a folder, each aside first and then renamed; their paths by name.

    Raises ValueError if the folder cannot be written.  Needs the extra `render` for the report.
    """
    from identification.report import diagnosis_page

    out = writable_folder(folder)
    page = diagnosis_page(diagnosis)
    paths = {name: out / name for name in ("diagnosis.json", "vehicle.toml", "report.html")}
    _write(paths["diagnosis.json"], json.dumps(as_json(diagnosis), indent=2) + "\n")
    notes = {e.path: f"named by a diagnosis of {diagnosis.source or 'a record'}" for e in diagnosis.effects}
    notes |= {c.path: f"refitted by a diagnosis of {diagnosis.source or 'a record'}" for c in diagnosis.coefficients}
    save_vehicle(diagnosis.after.plant, paths["vehicle.toml"], notes)
    _write(paths["report.html"], page)
    return paths


def writable_folder(folder: str | os.PathLike) -> Path:
    """The folder, made if need be; raises ValueError if nothing can be written into it."""
    out = Path(folder)
    try:
        out.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=out):
            pass
    except OSError as error:
        raise ValueError(
            f"Cannot write into {out}: {error.strerror or error}. Give another folder with --out."
        ) from None
    return out


def as_json(d: Diagnosis) -> dict[str, Any]:
    """The diagnosis as plain data; angles in rad, SI throughout."""
    metric = {
        "metric": "rmse of free runs in held-out windows",
        "horizon_s": d.window - d.settle,
        "window_s": d.window,
        "settle_s": d.settle,
        "windows_fitted": len(d.windows[0]),
        "windows_held_out": len(d.windows[1]),
    }
    return {
        "verdict": d.verdict,
        "summary": d.summary(),
        "effects": [
            {
                "path": e.path,
                "title": e.title,
                "value": e.value,
                "neutral": e.neutral,
                "unit": e.unit,
                "ci95": list(e.ci95),
                "evidence": {"fitted": e.evidence_train, "held_out": e.evidence_held},
                "tied_with": list(e.tied_with),
            }
            for e in d.effects
        ],
        "tied": [list(group) for group in d.tied],
        "error": {
            **metric,
            "as_given": _errors(d.given),
            "before": _errors(d.before),
            "after": _errors(d.after),
            "explained_share": d.explained,
        },
        "coefficients": [
            {"path": c.path, "unit": c.unit, "given": c.given, "value": c.value, "ci95": list(c.ci95)}
            for c in d.coefficients
        ],
        "coefficients_wrong": [c.path for c in d.coefficients if c.wrong],
        "angles_deg": [
            {" and ".join(c.paths): angle for c, angle in r.angles.items() if angle < SIMILAR}
            for r in d.rounds
            if r.chosen
        ],
        "detectable": [
            {"path": x.path, "unit": x.unit, "size": x.size if np.isfinite(x.size) else None, "reason": x.reason}
            for x in d.detectable
        ],
        "candidates": [
            [
                {
                    "paths": list(t.candidate.paths),
                    "evidence_fitted": t.train,
                    "evidence_held_out": t.held,
                    "values": [value_at(t.state.plant, p) for p in t.candidate.paths] if t.state else None,
                    "objection": t.objection,
                    "chosen": t is r.chosen,
                    "tied": t in r.tied,
                }
                for t in r.trials
            ]
            for r in d.rounds
        ],
        "remains": d.remains,
        "vehicle": {
            "name": d.given.plant.name,
            "family": d.given.plant.family.name,
            "parameters": {p: value_at(d.given.plant, p) for p in list_paths(d.given.plant)},
            "units": {p: spec_at(d.given.plant, p).unit for p in list_paths(d.given.plant)},
        },
        "source": d.source,
        "seed": d.seed,
        "versions": d.versions,
    }


def _errors(stage: Stage) -> dict[str, dict[str, float]]:
    return {name: score.as_dict() for name, score in stage.scores.items()}


def _write(path: Path, text: str) -> None:
    with replacing(path) as new:
        new.write_text(text, encoding="utf-8")
