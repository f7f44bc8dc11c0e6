"""The result of a diagnosis, and its summary in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.plant.currents import DiveCurrent
from auv_gym.records.record import Record
from identification.deciding import SLIGHT, STABLE, UNSTEADY
from identification.diagnosis.extras import Failure
from identification.diagnosis.judge.closing import ClosedLoop
from identification.diagnosis.judge.common import Common
from identification.diagnosis.judge.found import Coefficient, Detectable, Effect
from identification.diagnosis.judge.habitat import Habitat
from identification.diagnosis.log.checking import Asked
from identification.diagnosis.log.kinematics import Kinematics
from identification.diagnosis.log.plausibility import Doubt
from identification.diagnosis.log.several import in_last_log, logs_in
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Screening
from identification.diagnosis.search.discovery import Discovery
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.search.workbench import State
from identification.diagnosis.wording import (
    accelerations,
    capital,
    interval,
    lasting_errors,
    listed,
    quantity,
    short,
    sized,
)
from identification.fit.changing import ChangingPlant, changed, plain
from identification.fit.noises import Noise
from identification.fit.shooting import unknown_states
from identification.fit.validation import FreeRuns, Score, Whiteness

Verdict = Literal["none", "coefficients", "named", "tied", "unexplained", "doubted"]
RARE = "most halves of the log do not choose {it}"
VARIES = "parts of the log contradict each other in the size of {it}"
WORSE = "free runs over unseen parts of the log are worse with {it} than without"
LEANS = "the log gives no certain size for {it} without the effects that are not named"
_FEW_DIVES = 6  # that a sentence lists
_BETTER = 0.95  # of the refitted model's error, below which that of the given one is said to be less


@dataclass(frozen=True, eq=False)
class Stage:
    """A vehicle and its free runs over all windows.

    unseen: in each part of the record by a vehicle fitted and chosen without that part, which give the error; every: by
    the vehicle itself, for pictures; both from states fitted to the first seconds.  fitted: from states fitted to whole
    windows, for tests of whiteness.  without: of each part, the vehicle that was fitted and chosen without it.
    """

    plant: Plant
    unseen: FreeRuns
    every: FreeRuns
    fitted: FreeRuns
    scores: dict[str, Score]
    whiteness: dict[str, Whiteness]
    without: tuple[Plant, ...] = ()


@dataclass(frozen=True, eq=False)
class Diagnosis:
    """The result of comparing a record with a vehicle; `summary` puts it into words.

    given, refitted, after: the vehicle as it came, with its coefficients refitted, and with what was found.  before:
    what `after` is compared with: `refitted`, or `given` where nothing but coefficients was found.
    alike: effects of the vehicle after that are not named, since they do not explain the record.
    tied: groups of paths that the record cannot tell apart.  dropped: paths of effects that the search found and that
    are not named, each with the reason (`RARE`, `VARIES`, `WORSE`, `LEANS`).  explained: share of the squared error
    above the measurement noise that the effects remove.  windows: slices of the record, for each of its parts.
    doubts: what is wrong with the log itself.  discovery, habitat: of what no effect explains, where something is left.
    averaged: s, over which readings were averaged, 0 where each was read by itself.
    noise: of a sensor's reading and of the motion, as the filter found it.  left: what its one-step errors hold
    that noise would not.
    resting: states that nothing measures.  left_out: channels that were not compared.
    loops: the closed loop with each of the vehicles.
    common: what the members of each tie agree on.  planned: whether the experiment that tells them apart is planned.
    spread: the vehicle after, moved by a standard error in each independent direction of what was fitted.
    currents: of the dives between two GPS fixes, by the vehicle after.
    failures: parts that could not be made.  unfinished: steps that the search left out, having reached its limit, in
    words.  seconds: that each step took.
    """

    verdict: Verdict
    record: Record
    given: Stage
    refitted: Stage
    before: Stage
    after: Stage
    effects: tuple[Effect, ...]
    tied: tuple[tuple[str, ...], ...]
    coefficients: tuple[Coefficient, ...]
    detectable: tuple[Detectable, ...]
    rounds: tuple[Round, ...]
    state: State
    screening: tuple[Screening, ...]
    explained: float
    remains: dict[str, dict[str, Any]]
    windows: tuple[tuple[slice, ...], ...]
    window: float
    settle: float
    seed: int
    alike: tuple[Effect, ...] = ()
    asked: Asked = field(default_factory=Asked)
    dropped: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    kinematics: Kinematics | None = None
    discovery: Discovery | None = None
    habitat: Habitat | None = None
    noise: Noise | None = None
    averaged: float = 0.0
    left: Left = field(default_factory=Left)
    resting: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    loops: tuple[ClosedLoop, ...] = ()
    common: tuple[Common, ...] = ()
    planned: bool = False
    spread: tuple[Plant, ...] = ()
    currents: tuple[DiveCurrent, ...] = ()
    failures: tuple[Failure, ...] = ()
    unfinished: tuple[str, ...] = ()
    source: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def plants(self) -> dict[str, Plant]:
        """The vehicle as given, before and after; as in the last log, where logs have effects of their own."""
        stages = {"given": self.given, "before": self.before, "after": self.after}
        return {name: in_last_log(stage.plant, self.record) for name, stage in stages.items()}

    @property
    def changed(self) -> bool:
        """Whether anything was added to the vehicle: effects, or a term found in the data."""
        return bool(self.added) or (self.discovery is not None and self.discovery.holds)

    @property
    def added(self) -> tuple[Effect, ...]:
        """The effects of the vehicle after, named or not."""
        return (*self.effects, *self.alike)

    def noise_of(self, name: str) -> float:
        """The standard deviation of a sensor's noise as the filter found it; infinite where it is not known."""
        return self.noise.measurement.get(name, np.inf) if self.noise is not None else np.inf

    @property
    def unexplained(self) -> bool:
        """Whether something is left that neither the effects nor a refit explain."""
        return self.verdict == "unexplained" or self.discovery is not None

    @property
    def titles(self) -> dict[str, str]:
        """What effects and coefficients are called, by path."""
        named = {x.path: x.title for e in self.added for x in (*e.members, e)}
        others = {x.path: x.title for x in self.detectable} | {c.path: c.title for c in self.coefficients}
        return others | named

    @property
    def probabilities(self) -> dict[str, float]:
        """The probability of each named effect and of what it is tied with, by path."""
        members = {m.path: m.probability for e in self.added for m in e.members}
        return members | {e.path: e.probability for e in self.added if e.probability is not None}

    def dropped_for(self, reason: str) -> list[str]:
        """The titles of effects that were found and are not named for a reason."""
        titles = {r.chosen.candidate.paths[0]: r.chosen.candidate.title for r in self.rounds if r.chosen}
        return [titles.get(path, path) for path, why in self.dropped.items() if why == reason]

    @property
    def reach(self) -> str:
        """How far a scored free run goes, in words to follow `free runs`: over 100 s, or between buoyancy actions."""
        stepped = self.given.plant.family.stepped
        return "between buoyancy actions" if stepped else f"over {self.window - self.settle:g} s"

    @property
    def unseen_words(self) -> str:
        """What a vehicle has not seen: parts of the log, or dives where each has an unknown of its own."""
        segments = np.array([s.start for s in self.record.segments])
        used = {int(np.searchsorted(segments, w.start, side="right")) for part in self.windows for w in part}
        return "dives" if unknown_states(self.given.plant) and len(used) > 1 else "parts of the log"

    def summary(self) -> str:
        """The verdict in plain words, with the error before and after."""
        return " ".join(self.paragraphs())

    def paragraphs(self) -> list[str]:
        """The summary in paragraphs: verdict and errors; ties; doubts about effects; what remains; how it was read."""
        grouped = (
            (_sentence(self), _caution_sentence(self), unfinished_sentence(self), _error_sentence(self)),
            (_tied_sentence(self), _likelier_sentence(self), _common_sentence(self)),
            (
                _halves_sentence(self),
                _dives_sentence(self),
                unsteady_sentence(self),
                slight_sentence(self),
                dropped_sentence(self),
                _slight_sentence(self),
            ),
            (_rest_sentence(self), noise_sentence(self), _currents_sentence(self)),
            (_logs_sentence(self), _limit_sentence(self), averaged_sentence(self), _unseen_sentence(self)),
        )
        joined = (" ".join(sentence for sentence in group if sentence) for group in grouped)
        return [paragraph for paragraph in joined if paragraph]


def _alike(d: Diagnosis) -> str:
    alike = "; ".join(e.told for e in d.alike)
    return f" Part of the difference acts like {alike}." if alike else ""


def _sentence(d: Diagnosis) -> str:
    names = [e.told for e in d.effects]
    if d.verdict == "doubted":
        doubt = d.doubts[0]
        if doubt.slip is not None:
            return f"Something is wrong with the log: {doubt.text}. What to do: {doubt.mend}."
        return f"{doubt.text[0].upper()}{doubt.text[1:]}.{_alike(d)} What to do: {doubt.mend}."
    if d.verdict == "none":
        return "The model explains this log: no known effect is missing."
    wrong = [
        sized(c.title, quantity(c.value, c.unit), interval(c.ci95, c.unit), f"given {quantity(c.given, c.unit)}")
        for c in d.coefficients
        if c.wrong
    ]
    if d.verdict == "coefficients":
        return (
            "With corrected coefficients the model explains this log: no known effect is missing. "
            f"Corrected: {'; '.join(wrong)}."
        )
    if d.verdict == "unexplained":
        kind = "constant" if unsteady_sentence(d) else "known"
        return f"The log and the model disagree, and no {kind} effect explains the difference.{_alike(d)}"
    count = "an effect" if len(names) == 1 else f"{len(names)} effects"
    return f"The model is missing {count}: {'; '.join(names)}."


def _caution_sentence(d: Diagnosis) -> str:
    """What is doubted of a log that effects do not explain."""
    if d.verdict != "unexplained":
        return ""
    return " ".join(f"{doubt.text[0].upper()}{doubt.text[1:]}. What to do: {doubt.mend}." for doubt in d.doubts)


def unfinished_sentence(d: Diagnosis) -> str:
    """What is said of a search that ended at its limit, or nothing."""
    if not d.unfinished:
        return ""
    return (
        f"The search ended at its limit of computing time before it had {listed(d.unfinished)}: more effects may be "
        "missing, and others may explain this log as well. Shorten the log, or thin it by --resample."
    )


def _tied_sentence(d: Diagnosis) -> str:
    """The causes that the log cannot tell apart, with their probabilities."""
    if d.verdict != "tied":
        return ""
    titles, odds = d.titles, d.probabilities
    groups = [listed([_with_odds(titles.get(p, p), odds.get(p)) for p in group], "or") for group in d.tied]
    return f"This log cannot tell apart: {'; '.join(groups)}."


def _with_odds(title: str, probability: float | None) -> str:
    """A title with its probability in brackets, where there is one."""
    if probability is None:
        return title
    percent = 100.0 * probability
    words = "under 1 %" if percent < 1.0 else "over 99 %" if percent > 99.0 else f"{percent:.0f} %"
    return f"{short(title)} ({words})"


def _likelier_sentence(d: Diagnosis) -> str:
    """The members of a tie that are more probable than the effect in the fitted vehicle, and why."""
    told = []
    for e in d.effects:
        for m in e.members:
            if e.probability is None or round(100.0 * m.probability) <= round(100.0 * e.probability):
                continue
            spared = listed([short(d.titles.get(p, p)) for p in m.spared])
            why = f"with it, no {spared} is needed" if spared else "more of the sets that explain this log contain it"
            told.append(f"{capital(short(m.title))} is more probable than {short(e.name)}: {why}.")
    return " ".join(told)


def _common_sentence(d: Diagnosis) -> str:
    """What the members of each tie agree on, and what would tell them apart."""
    told = [common.words(d.titles, d.reach) for common in d.common]
    if told and not d.planned:
        told.append("Use --next-experiment to plan an experiment that tells them apart.")
    return " ".join(told)


def _halves_sentence(d: Diagnosis) -> str:
    """Effects that many halves of the log do not choose."""
    rare: dict[str, list[str]] = {}
    for e in d.added:
        if e.frequency < STABLE:
            rare.setdefault(f"{100.0 * e.frequency:.0f} %", []).append(short(e.name))
    told = [f"only {share} of the halves that were tried choose {listed(t)}" for share, t in rare.items()]
    return f"The choice was repeated with half of the log: {'; '.join(told)}." if told else ""


def _dives_sentence(d: Diagnosis) -> str:
    """The sizes of effects that differ between dives; of many, the smallest and the largest."""
    told = []
    for e in (e for e in d.added if e.by_dive):
        sizes, many = sorted(e.by_dive, key=lambda s: s.value), len(e.by_dive) > _FEW_DIVES
        own = [
            f"{quantity(s.value, e.unit)} (95 % interval {interval(s.ci95, e.unit)}) in {s.dive or 'the first dive'}"
            for s in ((sizes[0], sizes[-1]) if many else e.by_dive)
        ]
        range_of = f"from {' to '.join(own)}" if many else listed(own)
        told.append(f"{capital(short(e.name))} differs from dive to dive: {range_of}.")
    return " ".join(told)


def unsteady_sentence(d: Diagnosis) -> str:
    """Effects whose size differs between parts of the log, and not from dive to dive."""
    names = [short(e.name) for e in d.alike if e.unsteady]
    if not names:
        return ""
    which = "Its size" if len(names) == len(d.alike) == 1 else f"The size of {listed(names)}"
    return f"{which} differs between parts of the log: {_sought(d, 'when the effect begins or ends')}."


def _sought(d: Diagnosis, when: str) -> str:
    """Which command looks for what changes within a log, or between several."""
    within = f"`auv-gym onset` looks for {when}"
    if len(set(d.record.labels)) < 2:
        return within
    return f"`auv-gym compare-missions` compares the logs with each other, and {within}"


def slight_sentence(d: Diagnosis) -> str:
    """Effects whose size surely differs between parts of the log, and hardly."""
    slight = [e for e in d.added if e.steady < UNSTEADY and not (e.unsteady or e.by_dive)]
    told = listed([f"{short(e.name)} (by up to {100.0 * e.apart:.2g} %)" for e in slight])
    return f"Parts of the log differ slightly in the size of {told}." if slight else ""


def dropped_sentence(d: Diagnosis) -> str:
    """Effects that the search found and that are not named, or nothing."""
    told = []
    for reason in dict.fromkeys(d.dropped.values()):
        titles = d.dropped_for(reason)
        why = reason.format(it="it" if len(titles) == 1 else "them")
        told.append(f"The search also found {listed(titles)}, but {why}.")
    return " ".join(told)


def _slight_sentence(d: Diagnosis) -> str:
    """Effects that are certain but too small to matter."""
    told = []
    for e in d.effects:
        most = max(((size / d.noise_of(name), name) for name, size in e.changes.items()), default=(np.inf, ""))
        if most[0] < SLIGHT:
            name = most[1]
            size, noise = quantity(e.changes[name], channel(name).unit), quantity(d.noise_of(name), channel(name).unit)
            told.append(
                f"{capital(e.name)} is certain but small: it changes free runs {d.reach} by {size} in "
                f"{channel(name).label}, where the sensor noise is {noise}, and by even less in other channels."
            )
    return " ".join(told)


def _logs_sentence(d: Diagnosis) -> str:
    """What an effect comes to in each log where some of them differ in it, and which vehicle is written."""
    own = [changed(e.path)[1] for e in d.added if changed(e.path)[0]]
    if not own:
        return ""
    logs, told = logs_in(d.record), []
    plants = [d.after.plant.at_row(log.rows.start) for log in logs] if isinstance(d.after.plant, ChangingPlant) else []
    for path in dict.fromkeys(own):
        spec, sizes = spec_at(d.after.plant, path), [value_at(plant, path) for plant in plants]
        shown = range(len(logs)) if len(logs) <= _FEW_DIVES else (int(np.argmin(sizes)), int(np.argmax(sizes)))
        each = [f"{quantity(sizes[k], spec.unit)} in {logs[k].name}" for k in shown]
        by_log = listed(each) if len(logs) <= _FEW_DIVES else f"from {' to '.join(each)}"
        told.append(f"{capital(plain(spec.title))} by log: {by_log}.")
    return f"{' '.join(told)} vehicle.toml has the vehicle as it was in the last log, {logs[-1].name}."


def _limit_sentence(d: Diagnosis) -> str:
    """Coefficients that a fit moved to their limit."""
    limited = [c.title for c in d.coefficients if c.limited]
    if not limited:
        return ""
    many = len(limited) > 1
    return (
        f"The fit moved {listed(limited)} as far from the given {'values' if many else 'value'} as the stated "
        f"uncertainty allows. If {'they are' if many else 'it is'} less certain than that, raise --doubt or the "
        f"{'deviations' if many else 'deviation'} in the vehicle file."
    )


def _rest_sentence(d: Diagnosis) -> str:
    """The part of the error that nothing explains."""
    if d.discovery is None:
        return ""
    begin = "" if d.verdict == "unexplained" else "Part of the error remains unexplained. "
    begin += left_sentence(d)
    if d.discovery.holds:
        terms = listed([t.words for t in d.discovery.terms])
        begin += f"A term found in the data and confirmed on unseen parts of the log explains part of it: {terms}. "
    return (begin + (d.habitat.summary() if d.habitat is not None else "")).strip()


def left_sentence(d: Diagnosis) -> str:
    """The evidence that something is left, with a space behind it; empty if there is none."""
    left, shown = d.left, []
    for names, what in ((left.coloured, "are correlated in time"), (left.bursts, "come in bursts")):
        if names:
            shown.append(f"{what} ({', '.join(channel(name).label for name in names)})")
    if left.depends:
        of, pushed = channel(left.depends.signal).label, channel(left.depends.pushed).label
        law = f"past changes of {of}" if left.depends.remembers else of
        how = f"as errors of the reading of {pushed}" if left.depends.misread else f"acting on {pushed}"
        shown.append(f"depend on {law} ({how})")
    text = f"One-step prediction errors {listed(shown)}. " if shown else ""
    if left.gusts:
        pushed = listed([channel(name).label for name in left.gusts])
        text += (
            f"Random accelerations ({pushed}) are stronger at some times than at others: something acts now and then. "
        )
    if left.misread:
        misread = listed([channel(name).label for name in left.misread])
        text += f"Lasting sensor errors ({misread}) are larger at some times than at others. "
    if left.changes and left.changes not in {*d.dropped, *(e.path for e in d.alike)}:
        title = spec_at(d.state.plant, left.changes).title or left.changes
        text += f"The {title} differs between parts of the log: something changed during the log. "
    if left.passing:
        title = spec_at(d.state.plant, left.passing).title or left.passing
        text += (
            f"Something began, ended or changed during the log that acts like this effect: {title}. "
            f"{capital(_sought(d, 'when'))}. "
        )
    return text


def _error_sentence(d: Diagnosis) -> str:
    parts = []
    for name, before in d.before.scores.items():
        after = d.after.scores[name]
        label, unit = d.after.unseen.label(name), channel(name).unit
        if d.changed:
            parts.append(f"{label} {quantity(before.rmse, unit)} before, {quantity(after.rmse, unit)} after")
        else:
            beyond = float(np.sqrt(max(before.rmse**2 - d.noise_of(name) ** 2, 0.0)))
            known = np.isfinite(beyond) and quantity(beyond, unit) != quantity(before.rmse, unit)
            told = f" ({quantity(beyond, unit)} beyond the sensor noise)" if known else ""
            parts.append(f"{label} {quantity(before.rmse, unit)}{told}")
    told = f"RMS error of free runs {d.reach} in unseen {d.unseen_words}: {'; '.join(parts)}."
    worse = [name for name in d.before.scores if d.given.scores[name].rmse < _BETTER * d.before.scores[name].rmse]
    if not worse:
        return told
    given = [
        f"{d.given.unseen.label(name)} {quantity(d.given.scores[name].rmse, channel(name).unit)}" for name in worse
    ]
    return (
        f"{told} As given, the model errs less: {'; '.join(given)}. A refit makes the next reading likely, which may "
        "worsen free runs if an effect is missing."
    )


def noise_sentence(d: Diagnosis) -> str:
    """The process noise that the fit found, or nothing."""
    if d.noise is None:
        return ""
    told = []
    if d.noise.process:
        kinds = {"accelerations" if name.endswith("ps") else "drifts" for name in d.noise.process}
        pushed = accelerations(d.noise.process)
        told.append(f"Random {' and '.join(sorted(kinds))} push the vehicle (process noise): {pushed}.")
    for period, pushes in d.noise.swell.items():
        told.append(
            f"Accelerations with a period of {quantity(period, 's')} push it, as of waves: {accelerations(pushes)}."
        )
    for period, errors in d.noise.lasting.items():
        how = f"swing with a period of {quantity(period, 's')}" if period else "last"
        told.append(f"Some sensor errors {how}: {lasting_errors(errors)}.")
    return " ".join(told)


def _currents_sentence(d: Diagnosis) -> str:
    """The current of each dive, where GPS fixes show it."""
    if not d.currents:
        return ""
    dives = "; ".join(current.words for current in d.currents)
    return f"Depth-averaged current to the north and east, from GPS and dead reckoning, with 95 % intervals: {dives}."


def _unseen_sentence(d: Diagnosis) -> str:
    """States that nothing in the log measures."""
    speeds = [channel(name).label for name in d.resting if name.endswith("_mps")]
    if not speeds:
        return ""
    told = (
        f"The log does not measure {listed(speeds)}. The model computes these speeds from the commands, starting from "
        "rest and without process noise."
    )
    if d.left_out:
        names = listed([channel(name).label for name in d.left_out])
        told += f" {capital(names)} is not compared, because it depends on these speeds when the vehicle loops."
    return told


def averaged_sentence(d: Diagnosis) -> str:
    """The interval over which readings were averaged, or nothing."""
    return f"Readings were averaged over {quantity(d.averaged, 's')}." if d.averaged else ""
