"""Choice of the experiment that tells apart the effects that a record could not, and its duration."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np

from auv_gym.channels import truth_of
from auv_gym.model import Diverged
from auv_gym.param import replace_at, spec_at, value_at
from auv_gym.plant import Plant, save_vehicle
from auv_gym.records.record import Record
from auv_gym.writing import write_text
from identification.campaign.file.plan import plan
from identification.campaign.file.reading import read_campaign
from identification.campaign.file.settings import EnvExperiment, RunSettings
from identification.campaign.running.perform import run_status
from identification.campaign.running.staging import make_campaign_controller, make_env
from identification.deciding import LEAST_WINDOWS
from identification.diagnosis.judge.verdict import Diagnosis
from identification.experiments.designs import Design, campaign_text
from identification.experiments.driving import drive
from identification.experiments.kinds import KINDS
from identification.experiments.missions import mission_of, run_mission, sampling_of
from identification.fit.changing import ChangingPlant
from identification.fit.noises import Noise
from identification.fit.windows import free_run_windows
from identification.planning.separation import Knowledge, record_knowledge, record_noise, separation

ENOUGH = 25.0  # evidence that tells two effects apart: five standard errors, squared
FILE = "next_experiment.toml"
_FIRST = 2.0  # in shortest experiments: the length of the first simulations
_REFINED = 2  # number of designs that are simulated again, for their expected duration


@dataclass(frozen=True, eq=False)
class Rival:
    """One explanation of a record: the plant with it at its fitted size, and the paths that were fitted."""

    title: str
    plant: Plant
    paths: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Proposal:
    """A design, and what it promises for the two rivals that it separates least.

    evidence: expected from `simulated` minutes, in addition to the record.  minutes: expected until all rivals are told
    apart; infinite if that takes longer than allowed.  reason: why the design cannot be used, or "".
    """

    design: Design
    minutes: float
    evidence: float
    simulated: float
    pair: tuple[str, str]
    reason: str = ""


def rivals_of(diagnosis: Diagnosis) -> tuple[tuple[Rival, ...], ...]:
    """The groups of effects that a diagnosis could not tell apart, as the plants that explain the record.

    Empty for effects of some logs only, since no experiment can repeat those logs.
    """
    final, groups = diagnosis.state, []
    for number, found in enumerate(diagnosis.rounds):
        if found.chosen is None or not found.tied or isinstance(final.plant, ChangingPlant):
            continue
        later = [r.chosen for r in diagnosis.rounds[number + 1 :] if r.chosen is not None]
        beside = {p: value_at(final.plant, p) for t in later for p in t.candidate.free if p in final.paths}
        rivals = [Rival(found.chosen.candidate.title, final.plant, tuple(final.paths))]
        for trial in found.tied:
            if trial.state is None:
                continue
            added = {p: v for p, v in beside.items() if p not in trial.state.paths}
            paths = (*trial.state.paths, *added)
            rivals.append(Rival(trial.candidate.title, replace_at(trial.state.plant, added), paths))
        groups.append(tuple(rivals))
    return tuple(groups)


def next_experiment(
    plant: Plant,
    rivals: Sequence[Rival],
    *,
    record: Record | None = None,
    noise: Noise | None = None,
    designs: Sequence[Design] | None = None,
    minutes: tuple[float, float] | None = None,
    seed: int = 0,
    progress: Callable[[float, str], None] = lambda fraction, text: None,
) -> tuple[Proposal, ...]:
    """Designs sorted by the minutes that they need to tell all rivals apart, the quickest first.

    Each design is simulated with each rival.  The expected evidence is the part of its outputs that another rival
    cannot imitate with its effect, coefficients and starts refitted.  record: the one that they all explain; it limits
    the refit and gives the channels and the noise.  noise: of the sensors, instead of the record's.  minutes: the
    shortest and longest experiment.
    Raises ValueError with fewer than two rivals, or without record and noise.
    """
    if len(rivals) < 2:
        raise ValueError(f"An experiment tells at least two explanations apart, got {len(rivals)}.")
    if noise is None and record is None:
        raise ValueError("The next experiment needs the sensors' noise, from record= or as noise=, got neither.")
    minutes = minutes_of(plant) if minutes is None else minutes
    if not 0.0 < minutes[0] < minutes[1]:
        raise ValueError(f"The minutes need a least and a most, 0 < least < most, got {minutes}.")
    known: list[Knowledge | None] = [None] * len(rivals)
    if record is not None:
        windows = free_run_windows(plant, record, plant.window)
        noise = record_noise(rivals[0].plant, record, windows) if noise is None else noise
        known = [record_knowledge(r.plant, r.paths, record, windows, noise) for r in rivals]
    assert noise is not None
    rivals = [replace(r, paths=_free(r)) if k is None else replace(r, paths=k.paths) for r, k in zip(rivals, known)]
    chosen = KINDS.of(plant.family).designs(plant) if designs is None else tuple(designs)
    length, proposals = min(_FIRST * minutes[0], minutes[1]), []
    for number, design in enumerate(chosen):
        progress(0.8 * number / len(chosen), design.title)
        proposals.append(_proposal(design, plant, rivals, known, noise, length, minutes, seed))
    proposals.sort(key=_order)
    for number, first in enumerate(proposals[:_REFINED]):
        progress(0.8 + 0.2 * number / _REFINED, first.design.title)
        if np.isfinite(first.minutes) and abs(np.log(first.minutes / length)) > 0.2:
            again = _proposal(first.design, plant, rivals, known, noise, first.minutes, minutes, seed)
            proposals[number] = first if again.reason else again
    progress(1.0, "done")
    return tuple(sorted(proposals, key=_order))


def minutes_of(plant: Plant) -> tuple[float, float]:
    """The shortest and the longest sensible experiment with a vehicle, min.

    The shortest has one window more than a diagnosis of its log needs, of windows half as long as usual.
    """
    least, most = KINDS.of(plant.family).minutes(plant)
    return max(least, (LEAST_WINDOWS + 1) * 0.5 * plant.window / 60.0), most


def _order(proposal: Proposal) -> tuple[float, float, bool]:
    return (proposal.minutes, -proposal.evidence / max(proposal.simulated, 1e-9), bool(proposal.reason))


def write_experiment(proposal: Proposal, plant: Plant, rivals: Sequence[Rival], folder: Path, name: str = FILE) -> Path:
    """Write a design as a campaign over the rivals, with their vehicle files; returns the campaign file's path."""
    length = proposal.minutes if np.isfinite(proposal.minutes) else minutes_of(plant)[1]
    files = [f"{Path(name).stem}_{number + 1}.toml" for number in range(len(rivals))]
    for rival, file in zip(rivals, files, strict=True):
        save_vehicle(rival.plant, folder / file, dict.fromkeys(rival.paths, "of one explanation of a record"))
    told = " or ".join(rival.title for rival in rivals)
    text = campaign_text(
        Path(name).stem,
        f"{proposal.design.title}, to tell apart {told}",
        _tables(proposal.design, plant, length),
        files,
    )
    write_text(folder / name, text)
    return folder / name


def words(proposals: Sequence[Proposal]) -> str:
    """What to do next, in one sentence."""
    best = proposals[0]
    if not np.isfinite(best.minutes):
        pair = " and ".join(best.pair) or "these effects"
        return f"None of the experiments known here is expected to tell apart {pair}."
    hours = f"{best.minutes / 60.0:.0f} hours" if best.minutes >= 600.0 else f"{best.minutes:.0f} minutes"
    return f"To tell them apart, run {best.design.title}: about {hours} should suffice."


def _proposal(
    design: Design,
    plant: Plant,
    rivals: Sequence[Rival],
    known: Sequence[Knowledge | None],
    noise: Noise,
    length: float,
    minutes: tuple[float, float],
    seed: int,
) -> Proposal:
    """The promise of a design, from simulations of `length` minutes; each pair of rivals is compared one way only."""
    least, pair, simulated = inf, ("", ""), 0.0
    for i, rival in enumerate(rivals[:-1]):
        runs = _flown(design, plant, rival.plant, length, seed)
        if isinstance(runs, str):
            return Proposal(design, inf, 0.0, simulated, ("", ""), f"{rival.title}: {runs}")
        simulated = sum(r.duration_s for r in runs) / 60.0
        for j in range(i + 1, len(rivals)):
            size = separation(runs, rival.plant, rivals[j].plant, rivals[j].paths, noise, known[j])
            if size < least:
                least, pair = size, (rival.title, rivals[j].title)
    expected = max(length * ENOUGH / least, minutes[0]) if least > 0.0 else inf
    return Proposal(design, float(np.ceil(expected)) if expected <= minutes[1] else inf, least, simulated, pair)


def _flown(design: Design, plant: Plant, truth: Plant, minutes: float, seed: int) -> list[Record] | str:
    """The records of a design's runs with a plant, or the reason why there are none."""
    with tempfile.TemporaryDirectory(prefix="auv-gym-") as aside:
        folder = Path(aside)
        try:
            save_vehicle(truth, folder / "vehicle.toml")
            text = campaign_text(design.name, "", _tables(design, plant, minutes), ["vehicle.toml"])
            (folder / "campaign.toml").write_text(text, encoding="utf-8")
            runs = plan(read_campaign(folder / "campaign.toml", seed))
            return [_run(run.settings, truth, folder) for run in runs]
        except (ValueError, Diverged) as error:
            return " ".join(str(error).split())


def _run(settings: RunSettings, truth: Plant, folder: Path) -> Record:
    """The record of one run of a campaign, with the true states; raises if the run was cut short."""
    experiment = settings.experiment
    if not isinstance(experiment, EnvExperiment):
        exact = truth if mission_of(truth).sampled else replace_at(truth, dict.fromkeys(sampling_of(truth), 0.0))
        return run_mission(exact, np.random.default_rng(settings.seed), **getattr(experiment, "settings", {}))
    env = make_env(settings, folder)
    controller = make_campaign_controller(settings, env, folder)
    run = drive(env, controller, seed=settings.seed, targets=experiment.steps, start=experiment.start)
    if run_status(run.reason) != "done":
        raise ValueError(f"the run was cut short: {run.reason}")
    return run.record.with_channels({truth_of(name): run.truth[name] for name in run.truth.names})


def _tables(design: Design, plant: Plant, minutes: float) -> dict:
    """The design's campaign tables, for a whole number of samples."""
    return design.tables(plant, float(max(round(60.0 * minutes / plant.dt), 10)) * plant.dt)


def _free(rival: Rival) -> tuple[str, ...]:
    """The paths that a fit may free."""
    return tuple(p for p in rival.paths if spec_at(rival.plant, p).probe > 0.0 or p in rival.plant.coefficients)
