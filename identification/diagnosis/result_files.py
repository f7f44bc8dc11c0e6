"""The files that a diagnosis writes: diagnosis.json, vehicle.toml and report.html."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Collection, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.param import list_paths, replace_at, spec_at, value_at
from auv_gym.plant import Plant, save_vehicle
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record
from auv_gym.vehicles import Body, Part, family_named
from auv_gym.writing import finite, writable_folder, write_text
from identification.deciding import SIMILAR
from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge.effects import Effect
from identification.diagnosis.judge.result import Stage
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.search.trials import Progress
from identification.fit.changing import ChangingPlant, changed


def write_diagnosis(diagnosis: Diagnosis, folder: str | os.PathLike, extras: Extras | None = None) -> dict[str, Path]:
    """Write the three files into a folder; returns their paths by name.  Files are written aside, then renamed.

    If a picture or page cannot be drawn, this is recorded in `extras` as a failure and reported in the other files.
    Raises ValueError if the folder cannot be written, ImportError without the extra `render`, which the report needs.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import closed_loop, diagnose, write_diagnosis
        >>> glider = load_vehicle("slocum")
        >>> found = diagnose(closed_loop(glider, rng=np.random.default_rng(0)), glider, most=1)
        >>> sorted(path.name for path in write_diagnosis(found, "result").values())
        ['diagnosis.json', 'report.html', 'vehicle.toml']
    """
    from identification.pages.diagnosis_page import diagnosis_page
    from identification.pages.drawing import require_render

    require_render()
    extras = extras or Extras()
    out = writable_folder(folder)
    paths = {name: out / name for name in ("diagnosis.json", "vehicle.toml", "report.html")}
    write_text(paths["diagnosis.json"], _json_text(diagnosis, extras))
    told = ((diagnosis.effects, "named by"), (diagnosis.alike, "acts like the difference, but is not named, in"))
    notes = {
        changed(e.path)[1]: f"{words} a diagnosis of {diagnosis.source or 'a record'}"
        for own, words in told
        for e in own
    }
    notes |= {c.path: f"refitted by a diagnosis of {diagnosis.source or 'a record'}" for c in diagnosis.coefficients}
    after = diagnosis.plants["after"]
    fitted = replace(after, fitted_to=_with_log(after.fitted_to, diagnosis.source or "a record"))
    save_vehicle(fitted, paths["vehicle.toml"], notes)
    before = len(extras.failures)
    page = extras.attempt("The report", lambda: diagnosis_page(diagnosis, extras), "")
    if page:
        write_text(paths["report.html"], page)
    else:
        paths.pop("report.html").unlink(missing_ok=True)  # a leftover page would be taken for this one's
    if len(extras.failures) > before:
        write_text(paths["diagnosis.json"], _json_text(diagnosis, extras))
    return paths


def _with_log(fitted_to: str, log: str) -> str:
    """The logs that a vehicle was fitted to, and one more; each once."""
    return "; ".join(dict.fromkeys(filter(None, [*fitted_to.split("; "), log])))


def _json_text(diagnosis: Diagnosis, extras: Extras) -> str:
    failures = (*diagnosis.failures, *extras.failures)
    return json.dumps(as_json(replace(diagnosis, failures=failures)), indent=2) + "\n"


def as_json(d: Diagnosis) -> dict[str, Any]:
    """The diagnosis as plain data; angles in rad, SI throughout."""
    given = d.plants["given"]
    metric = {
        "metric": "RMS error of free runs in unseen parts of the log",
        "horizon_s": d.window - d.settle,
        "window_s": d.window,
        "settle_s": d.settle,
        "parts": len(d.windows),
        "windows": sum(len(part) for part in d.windows),
    }
    searched = {p for r in d.rounds if r.chosen for p in r.chosen.candidate.paths}  # not from a coefficient's change
    return {
        "verdict": d.verdict,
        "summary": d.summary(),
        "effects": [_effect(e, searched) | _in_last_log(d, e) for e in d.effects],
        "acts_like": [_effect(e, searched) | _in_last_log(d, e) for e in d.alike],
        "tied": [list(group) for group in d.tied],
        "common_prediction": [finite(asdict(c)) for c in d.common],
        "dropped": [{"path": path, "why": why.format(it="it")} for path, why in d.dropped.items()],
        "error": {
            **metric,
            "as_given": _errors(d.given),
            "refitted": _errors(d.refitted),
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
                    "evidence_all_rows": t.train,
                    "evidence_cross_validated": t.held,
                    "values": [value_at(t.state.plant, p) for p in t.candidate.paths] if t.state else None,
                    "objection": t.objection,
                    "chosen": t is r.chosen,
                    "tied": t in r.tied,
                }
                for t in r.trials
            ]
            for r in d.rounds
        ],
        "unexplained": d.unexplained,
        "left": asdict(d.left),
        "doubts": [
            {
                "text": x.text,
                "channels": list(x.channels),
                "gain": finite(x.gain),
                "mend": x.mend,
                "slip": x.slip is not None,
            }
            for x in d.doubts
        ],
        "kinematics": _kinematics(d),
        "discovered": _discovered(d),
        "habitat": d.habitat.summary() if d.habitat is not None else None,
        "process_noise": _noise(d),
        "averaged_over_s": d.averaged,
        "currents": [current._asdict() for current in d.currents],
        "closed_loop": [finite(asdict(loop)) for loop in d.loops],
        "unfinished": list(d.unfinished),
        "failures": [asdict(failure) for failure in d.failures],
        "remains": d.remains,
        "vehicle": {
            "name": given.name,
            "family": given.family.name,
            "parts": [finite(asdict(part)) for part in (given.family.body or Body(())).parts],
            "dt_s": given.dt,
            "longest_step_s": given.longest_step,
            "window_s": given.window,
            "settle_s": given.settle,
            "deviations": dict(given.deviations),
            "fitted_to": given.fitted_to,
            "parameters": {p: value_at(given, p) for p in list_paths(given)},
            "units": {p: spec_at(given, p).unit for p in list_paths(given)},
        },
        "asked": asdict(d.asked),
        "record_sha256": digest_of(d.record),
        "source": d.source,
        "log_notes": d.record.notes,
        "seed": d.seed,
        "versions": d.versions,
    }


def _effect(e: Effect, searched: Collection[str]) -> dict[str, Any]:
    """An effect as plain data; searched: paths of the effects that the search chose."""
    return {
        "path": e.path,
        "title": e.title,
        "value": e.value,
        "neutral": e.neutral,
        "unit": e.unit,
        "ci95": list(e.ci95),
        "evidence": {"all_rows": e.evidence_train, "cross_validated": e.evidence_held},
        "frequency": e.frequency if e.path in searched else None,
        "steady": e.steady,
        "apart": finite(e.apart),
        "by_dive": [{"dive": d.dive, "value": d.value, "ci95": list(d.ci95)} for d in e.by_dive],
        "changes": {name: finite(size) for name, size in e.changes.items()},
        "tied_with": list(e.tied_with),
        "probability": e.probability,
        "members": [finite(asdict(m)) for m in e.members],
        "coefficient": finite(asdict(e.coefficient)) if e.coefficient else None,
    }


def _in_last_log(d: Diagnosis, e: Effect) -> dict[str, Any]:
    """The value of an effect in the last log, for effects of some logs only; None if that log does not have it."""
    form, path = changed(e.path)
    plant = d.after.plant
    if not form or not isinstance(plant, ChangingPlant):
        return {}
    if not plant.courses[form].at(len(d.record) - 1):
        return {"in_last_log": None}
    value = value_at(d.plants["after"], path)
    return {"in_last_log": {"path": path, "value": value, "ci95": [value - e.value + end for end in e.ci95]}}


def again(file: str | os.PathLike, record: Record, progress: Progress = lambda fraction, text: None) -> Diagnosis:
    """Repeat the diagnosis of a diagnosis.json file; raises ValueError if the record is a different one."""
    try:
        told: dict[str, Any] = json.loads(Path(file).read_text(encoding="utf-8"))
        vehicle, asked, digest = told["vehicle"], told["asked"], told["record_sha256"]
        known: dict[str, Any] = {name: vehicle[name] for name in ("deviations", "fitted_to")}
        parts = [Part(**(part | {"channels": tuple(part["channels"])})) for part in vehicle["parts"]]
    except FileNotFoundError:
        raise ValueError(f"There is no file {file}. Give the diagnosis.json that `auv-gym diagnose` wrote.") from None
    except (json.JSONDecodeError, UnicodeDecodeError):
        raise ValueError(
            f"{file} is no diagnosis.json, since it does not hold JSON. Give the diagnosis.json that `auv-gym "
            "diagnose` wrote."
        ) from None
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{file} is no diagnosis.json of this version ({error}): run the diagnosis again.") from error
    family = family_named(vehicle["family"], parts)
    times: dict[str, Any] = {name: vehicle[f"{name}_s"] for name in ("dt", "longest_step", "window", "settle")}
    plant = replace_at(Plant(vehicle["name"], family, family.parameters(), **times, **known), vehicle["parameters"])
    if digest != digest_of(described(plant, record)):
        raise ValueError(
            f"{file} was made from another record, or from one read differently: give the same log, mapping and cuts."
        )
    return diagnose(record, plant, source=told["source"], progress=progress, **asked)


def digest_of(record: Record) -> str:
    """A hash of the record's times and channels, to check that two readings of a log are the same."""
    found = hashlib.sha256(np.ascontiguousarray(record.time).tobytes())
    for name in sorted(record.names):
        found.update(name.encode() + np.ascontiguousarray(record[name]).tobytes())
    return found.hexdigest()


def _kinematics(d: Diagnosis) -> dict[str, Any] | None:
    if d.sensors is None:
        return None
    return {
        "mismatches": [finite(asdict(m)) for m in d.sensors.mismatches],
        "cleared": [c.path for c in d.sensors.clears],
        "compared": list(d.sensors.equations),
    }


def _discovered(d: Diagnosis) -> dict[str, Any] | None:
    if d.discovery is None:
        return None
    terms = [finite(asdict(t)) | {"words": t.words} for t in d.discovery.terms]
    rejected = [finite(asdict(t)) | {"words": t.words} for t in d.discovery.rejected]
    return {"holds": d.discovery.holds, "terms": terms, "rejected": rejected}


def _noise(d: Diagnosis) -> dict[str, Any] | None:
    if d.noise is None:
        return None

    def told(pushes: Mapping[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
        return {n: {"rms": size, "correlation_time_s": time} for n, (size, time) in pushes.items()}

    swell = [{"period_s": period, "pushes": told(pushes)} for period, pushes in d.noise.swell.items()]
    lasting = [{"period_s": period or None, "errors": told(errors)} for period, errors in d.noise.lasting.items()]
    process = told(d.noise.process)
    return {"measurement": dict(d.noise.measurement), "process": process, "swell": swell, "lasting": lasting}


def _errors(stage: Stage) -> dict[str, dict[str, float]]:
    return {name: score.as_dict() for name, score in stage.scores.items()}
