"""The attempt on one log of each part of the study, as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from auv_gym.param import spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.diagnosis import diagnose
from identification.fit.greybox import GreyBox
from identification.fit.shooting import Shooting
from identification.fit.windows import free_run_windows
from scripts.studies.process_noise.logs import Case, draw

WRONG = 0.1  # relative error of the initial coefficients of fits
METHODS = {"filter": True, "free runs": False}  # whether a fit has process noise, by name
EXCITED = 1e-6  # of a coefficient's sensitivity, in noises by its scale, as in a diagnosis


def parameters(family: str, seed: int, loop: str, times: float) -> dict[str, Any]:
    """Estimates of an effect and the coefficients by each method, with the truth, and the process noise found.

    side: the sign of the effect, so that positive errors are those of effects that are found too large.
    """
    case = draw(family, seed, loop, effect=True, times=times, wrong=WRONG)
    free = [case.effect, *excited(case.believed, case.record)]
    side = 1.0 if case.size > spec_at(case.plant, case.effect).neutral else -1.0
    result: dict[str, Any] = {**_told(case), "fits": {}}
    for method, process in METHODS.items():
        fit = GreyBox(case.believed, free=free, process=process).fit(case.record)
        result["fits"][method] = {
            path: {
                "value": fit[path].value,
                "error": fit[path].error,
                "ci95": fit[path].ci95,
                "truth": value_at(case.plant, path),
                "side": side if path == case.effect else 1.0,
                "problem": fit[path].problem,
            }
            for path in free
        }
        if process:
            result["found"] = noise_of(fit)
    return result


def clean(family: str, seed: int, loop: str, times: float) -> dict[str, Any]:
    """The diagnosis of a log of the vehicle as believed."""
    case = draw(family, seed, loop, effect=False, times=times)
    return _told(case) | diagnosed(case)


def names(family: str, seed: int, loop: str, times: float) -> dict[str, Any]:
    """The diagnosis of a log of a vehicle with one effect."""
    case = draw(family, seed, loop, effect=True, times=times)
    return _told(case) | diagnosed(case)


def diagnosed(case: Case) -> dict[str, Any]:
    """Verdict, names and stated process noise of a case; right: the effect is named or tied; false: other names."""
    said = diagnose(case.record, case.believed)
    named = {effect.path: {effect.path, *effect.tied_with} for effect in said.effects}
    for group in said.tied:
        for path, meant in named.items():
            if path in group:
                meant.update(group)
    return {
        "verdict": said.verdict,
        "named": sorted(named),
        "tied": [sorted(group) for group in said.tied],
        **judged(case.effect, named, said.tied),
        "found": noise_of(said),
    }


def judged(effect: str, named: Mapping[str, set[str]], tied: Sequence[Sequence[str]]) -> dict[str, Any]:
    """right: whether the effect is named, or tied.  false: names that do not mean it.

    named: by path, the paths that the diagnosis cannot tell it from, including itself.
    """
    known = any(effect in meant for meant in named.values()) or any(effect in group for group in tied)
    return {"right": bool(effect) and known, "false": sorted(p for p, meant in named.items() if effect not in meant)}


def excited(plant: Plant, record: Record) -> list[str]:
    """The coefficients that the record's inputs excite."""
    problem = Shooting(plant, record, free_run_windows(plant, record, plant.window))
    point = problem.point(plant.vector, problem.first_guess)
    raw = problem.linearise(point, plant.coefficients, problem.sigma(point)).raw
    return [path for path, size in zip(plant.coefficients, raw, strict=True) if size > EXCITED]


def noise_of(result: Any) -> dict[str, tuple[float, float]]:
    """Deviation and correlation time of the process noise that a fit or a diagnosis states, by velocity."""
    noise = result.noise
    return {name: (float(size), float(tau)) for name, (size, tau) in noise.process.items()} if noise else {}


def _told(case: Case) -> dict[str, Any]:
    """The drawn truth."""
    return {
        "effect": case.effect,
        "size": case.size,
        "error": case.error,
        "process": {name: list(pair) for name, pair in case.process.items()},
        "free_run": case.free_run,
        "shown": dict(case.shown),
    }


PARTS = {"parameters": parameters, "clean": clean, "names": names}
