"""The text of a diagnosis: its summary, sentence by sentence."""

from __future__ import annotations

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import listed, spec_at, value_at
from auv_gym.records.attitude import ANGLES
from identification.deciding import SLIGHT, STABLE, UNSTEADY
from identification.diagnosis.judge.effects import Effect, Member
from identification.diagnosis.judge.leftover import beyond_noise, drift_sentence, noise_sentence, rest_sentence, sought
from identification.diagnosis.judge.result import Result
from identification.diagnosis.log.parts import logs_in
from identification.diagnosis.wording import capital, inside, interval, quantity, short, sized, typeset
from identification.fit.changing import ChangingPlant, changed, plain

_FEW_DIVES = 6  # dives listed in one sentence
_FEW_COEFFICIENTS = 4  # coefficients listed in one sentence
_BETTER = 0.95  # of the refitted model's error; the model as given errs less if its error is below that


def paragraphs(d: Result) -> list[str]:
    """The summary in paragraphs: verdict and errors; ties; doubts about effects; what remains; how it was read."""
    grouped = (
        (_sentence(d), _refitted_sentence(d), _caution_sentence(d), unfinished_sentence(d), _error_sentence(d)),
        (_tied_sentence(d), _likelier_sentence(d), _common_sentence(d)),
        (
            _halves_sentence(d),
            _dives_sentence(d),
            unsteady_sentence(d),
            slight_sentence(d),
            dropped_sentence(d),
            _slight_sentence(d),
        ),
        (rest_sentence(d), noise_sentence(d), drift_sentence(d), _currents_sentence(d)),
        (_logs_sentence(d), _limit_sentence(d), averaged_sentence(d), _unseen_sentence(d)),
    )
    joined = (typeset(" ".join(sentence for sentence in group if sentence)) for group in grouped)
    return [paragraph for paragraph in joined if paragraph]


def _alike(d: Result) -> str:
    alike = "; ".join(e.told for e in d.alike)
    return f" Part of the difference acts like {alike}." if alike else ""


def _sentence(d: Result) -> str:
    names = [_with_likelier(e) for e in d.effects]
    if d.verdict == "doubted":
        doubt = d.doubts[0]
        if doubt.slip is not None:
            return f"Something is wrong with the log: {doubt.text}. What to do: {doubt.mend}."
        return f"{doubt.text[0].upper()}{doubt.text[1:]}.{_alike(d)} What to do: {doubt.mend}."
    if d.verdict == "none":
        if d.noise is None or not (d.noise.process or d.noise.swell) or not _errs_more_than_sensors(d):
            return "The model explains this log: no known effect is missing."
        return (
            "Together with random accelerations (process noise), the model explains this log: no known effect is "
            "missing that this log could show."
        )
    wrong = [
        sized(c.title, inside(c.value, c.ci95, c.unit), interval(c.ci95, c.unit), f"given {quantity(c.given, c.unit)}")
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
    missing = sum(e.coefficient is None for e in d.effects)
    told = [f"is missing {_counted(missing, 'effect')}"] if missing else []
    told += [f"has {_counted(len(names) - missing, 'wrong coefficient')}"] if missing < len(names) else []
    small = ", certain but small" if all(_most_changed(d, e)[0] < SLIGHT for e in d.effects) else ""
    return f"The model {' and '.join(told)}{small}: {'; '.join(names)}."


def _counted(count: int, noun: str) -> str:
    """A number of things; one has an article."""
    return f"{count} {noun}s" if count > 1 else f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"


def _errs_more_than_sensors(d: Result) -> bool:
    """Whether free runs err by more than the sensor noise in any channel, beyond that noise."""
    return any(beyond_noise(d, name) > d.noise_of(name) for name in d.after.scores)


def likelier(e: Effect) -> list[Member]:
    """Members tied with a named effect that are more probable (in whole percent); the most probable first."""
    if e.probability is None:
        return []
    own = round(100.0 * e.probability)
    return sorted((m for m in e.members if round(100.0 * m.probability) > own), key=lambda m: -m.probability)


def _with_likelier(e: Effect) -> str:
    """A named effect with its size, after any causes that are more probable, with theirs; and a word on the others."""
    others = likelier(e)
    told = [*(sized(m.title, m.size, interval(m.ci95, m.unit)) for m in others), e.told]
    more = len(e.members) - len(others)
    if more:
        told.append("a cause that acts alike" if more == 1 else "causes that act alike")
    return ", or ".join(told)


def _refitted_sentence(d: Result) -> str:
    """Coefficients that differ significantly from the given value and are not mentioned elsewhere; largest first."""
    told = {e.coefficient.path for e in d.effects if e.coefficient is not None}
    told |= {c.path for c in d.coefficients if c.wrong and d.verdict == "coefficients"}
    moved = [c for c in d.coefficients if c.moved and c.path not in told]
    if not moved or d.verdict == "doubted":
        return ""
    moved.sort(key=lambda c: -abs(c.value - c.given) / max(abs(c.given), 1e-300))
    listing = "; ".join(f"{c.title} {c.change}" for c in moved[:_FEW_COEFFICIENTS])
    more = len(moved) - _FEW_COEFFICIENTS
    return f"Refitted coefficients: {listing}{f'; and {more} more' if more > 0 else ''}."


def _caution_sentence(d: Result) -> str:
    """Doubts about a log that effects do not explain."""
    if d.verdict != "unexplained":
        return ""
    return " ".join(f"{doubt.text[0].upper()}{doubt.text[1:]}. What to do: {doubt.mend}." for doubt in d.doubts)


def unfinished_sentence(d: Result) -> str:
    """The warning that the search stopped at its time limit, or nothing."""
    if not d.unfinished:
        return ""
    return (
        f"The search ended at its limit of computing time before it had {listed(d.unfinished)}: more effects may be "
        "missing, and others may explain this log as well. Shorten the log, or thin it by --resample."
    )


def _tied_sentence(d: Result) -> str:
    """The causes that the log cannot tell apart, with their probabilities; the most probable first."""
    if d.verdict != "tied":
        return ""
    titles, odds = d.titles, d.probabilities
    ordered = [sorted(group, key=lambda p: -round(100.0 * odds.get(p, 0.0))) for group in d.tied]
    groups = [listed([_with_odds(titles.get(p, p), odds.get(p)) for p in group], "or") for group in ordered]
    return f"This log cannot tell apart: {'; '.join(groups)}."


def _with_odds(title: str, probability: float | None) -> str:
    """A title with its probability in brackets, if it has one."""
    if probability is None:
        return title
    percent = 100.0 * probability
    words = "under 1 %" if percent < 1.0 else "over 99 %" if percent > 99.0 else f"{percent:.0f} %"
    return f"{short(title)} ({words})"


def _likelier_sentence(d: Result) -> str:
    """The members of a tie that are more probable than the effect in the fitted vehicle, and why."""
    told = []
    for e in d.effects:
        reasons: dict[str, list[str]] = {}
        for m in likelier(e):
            spared = listed([short(d.titles.get(p, p)) for p in m.spared])
            why = f", since no {spared} is needed with it" if spared else " if all sets of effects are counted"
            reasons.setdefault(why, []).append(short(m.title))
        others = [
            f"{listed(names)} {'is' if len(names) == 1 else 'are'} more probable{w}" for w, names in reasons.items()
        ]
        if others:
            told.append(f"The fitted vehicle has {short(e.name)}; {'; '.join(others)}.")
    return " ".join(told)


def _common_sentence(d: Result) -> str:
    """What the members of each tie agree on, and what would tell them apart."""
    told = [common.words(d.titles, d.reach) for common in d.common]
    if told and not d.planned:
        told.append("Use --next-experiment to plan an experiment that tells them apart.")
    return " ".join(told)


def _halves_sentence(d: Result) -> str:
    """Effects that many halves of the log do not choose."""
    rare: dict[str, list[str]] = {}
    for e in d.added:
        if e.frequency < STABLE:
            rare.setdefault(f"{100.0 * e.frequency:.0f} %", []).append(short(e.name))
    told = [f"only {share} of the halves that were tried choose {listed(t)}" for share, t in rare.items()]
    return f"The choice was repeated with half of the log: {'; '.join(told)}." if told else ""


def _dives_sentence(d: Result) -> str:
    """The sizes of effects that differ between dives; if there are many dives, the smallest and the largest size."""
    told = []
    for e in (e for e in d.added if e.by_dive):
        sizes, many = sorted(e.by_dive, key=lambda s: s.value), len(e.by_dive) > _FEW_DIVES
        own = [
            f"{inside(s.value, s.ci95, e.unit)} (95 % interval {interval(s.ci95, e.unit)}) in "
            f"{s.dive or 'the first dive'}"
            for s in ((sizes[0], sizes[-1]) if many else e.by_dive)
        ]
        range_of = f"from {' to '.join(own)}" if many else listed(own)
        told.append(f"{capital(short(e.name))} differs from dive to dive: {range_of}.")
    return " ".join(told)


def unsteady_sentence(d: Result) -> str:
    """Effects whose size differs between parts of the log, other than from dive to dive."""
    names = [short(e.name) for e in d.alike if e.unsteady]
    if not names:
        return ""
    which = "Its size" if len(names) == len(d.alike) == 1 else f"The size of {listed(names)}"
    return f"{which} differs between parts of the log: {sought(d, 'when the effect begins or ends')}."


def slight_sentence(d: Result) -> str:
    """Effects whose size differs significantly, but only slightly, between parts of the log."""
    slight = [e for e in d.added if e.steady < UNSTEADY and not (e.unsteady or e.by_dive)]
    told = listed([f"{short(e.name)} (by up to {100.0 * e.apart:.2g} %)" for e in slight])
    return f"Parts of the log differ slightly in the size of {told}." if slight else ""


def dropped_sentence(d: Result) -> str:
    """Effects that the search found but that are not named, or nothing."""
    told = []
    for reason in dict.fromkeys(d.dropped.values()):
        titles = d.dropped_for(reason)
        why = reason.format(it="it" if len(titles) == 1 else "them")
        told.append(f"The search also found {listed(titles)}, but {why}.")
    return " ".join(told)


def _slight_sentence(d: Result) -> str:
    """Effects that are certain but too small to matter."""
    told = []
    for e in d.effects:
        share, name = _most_changed(d, e)
        if share < SLIGHT:
            size, noise = quantity(e.changes[name], channel(name).unit), quantity(d.noise_of(name), channel(name).unit)
            others = ", and by even less in other channels" if len(e.changes) > 1 else ""
            told.append(
                f"{capital(e.name)} is certain but small: it changes free runs {d.reach} by {size} in "
                f"{channel(name).label}, where the sensor noise is {noise}{others}."
            )
    return " ".join(told)


def _most_changed(d: Result, e: Effect) -> tuple[float, str]:
    """The largest change of free runs by an effect, over the noise of the channel's sensor, and the channel."""
    return max(((size / d.noise_of(name), name) for name, size in e.changes.items()), default=(np.inf, ""))


def _logs_sentence(d: Result) -> str:
    """The size of an effect in each log, if it differs between logs, and which log's vehicle is written to the file."""
    own, after = [changed(e.path)[1] for e in d.added if changed(e.path)[0]], d.after.plant
    if not own or not isinstance(after, ChangingPlant):
        return ""
    logs, told = logs_in(d.record), []
    plants = [after.at_row(log.rows.start) for log in logs]
    for path in dict.fromkeys(own):
        spec, sizes = spec_at(after, path), [value_at(plant, path) for plant in plants]
        shown = range(len(logs)) if len(logs) <= _FEW_DIVES else (int(np.argmin(sizes)), int(np.argmax(sizes)))
        each = [f"{quantity(sizes[k], spec.unit)} in {logs[k].name}" for k in shown]
        by_log = listed(each) if len(logs) <= _FEW_DIVES else f"from {' to '.join(each)}"
        told.append(f"{capital(plain(spec.title))} by log: {by_log}.")
    return f"{' '.join(told)} vehicle.toml has the vehicle as it was in the last log, {logs[-1].name}."


def _limit_sentence(d: Result) -> str:
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


def _error_sentence(d: Result) -> str:
    """The free-run errors: before and after, or of the refitted vehicle; and as given if that vehicle errs less."""
    parts, corrected = [], d.before is d.given and d.before is not d.after
    first = "as given" if corrected else "before"
    last = "after" if d.changed and d.after is not d.refitted else "refitted"
    for name, before in d.before.scores.items():
        after = d.after.scores[name]
        label, unit = d.after.unseen.label(name), channel(name).unit
        size = quantity(after.rmse, unit)
        if d.changed or corrected:
            size = f"{quantity(before.rmse, unit)} {first}, {size} {last}"
        told = ""
        if not d.changed:
            beyond = beyond_noise(d, name)
            known = np.isfinite(beyond) and quantity(beyond, unit) != quantity(after.rmse, unit)
            told = f" ({quantity(beyond, unit)} beyond the sensor noise)" if known else ""
        parts.append(f"{label} {size}{told}")
    told = f"RMS error of free runs {d.reach} in unseen {d.unseen_words}: {'; '.join(parts)}."
    worse = [name for name, refit in d.refitted.scores.items() if d.given.scores[name].rmse < _BETTER * refit.rmse]
    if not worse:
        return told
    given = [
        f"{d.given.unseen.label(name)} {quantity(d.given.scores[name].rmse, channel(name).unit)}" for name in worse
    ]
    why = "A refit optimises one-step predictions, which may worsen free runs if an effect is missing."
    if d.added and d.after is not d.refitted:
        why = "The refit without the effects optimises one-step predictions, which may worsen free runs."
    elif d.only_pushed:
        why = "Free runs do not include the random accelerations, and may come out worse by chance."
    return f"{told} As given, the model errs less: {'; '.join(given)}. {why}"


def _currents_sentence(d: Result) -> str:
    """The depth-averaged current of each dive, if there are GPS fixes."""
    if not d.currents:
        return ""
    dives = "; ".join(current.words for current in d.currents)
    return f"Depth-averaged current to the north and east, from GPS and dead reckoning, with 95 % intervals: {dives}."


def _unseen_sentence(d: Result) -> str:
    """The states that no sensor in the log measures."""
    followed = [name for name in d.resting if name in d.given.plant.family.driven]
    speeds = [channel(name).label for name in followed if name.endswith("_mps")]
    angles = [channel(name).label for name in followed if name in ANGLES]
    if not speeds and not angles:
        return ""
    these = " and ".join(filter(None, ["these speeds" if speeds else "", "these angles" if angles else ""]))
    told = (
        f"The log does not measure {listed([*speeds, *angles])}. The model computes {these} from the commands, from "
        "rest and without process noise. Where the vehicle moves otherwise, an effect may be named in its place."
    )
    if d.left_out:
        names = listed([channel(name).label for name in d.left_out])
        told += f" {capital(names)} is not compared, because it depends on these speeds when the vehicle loops."
    return told


def averaged_sentence(d: Result) -> str:
    """The interval over which readings were averaged, and why, or nothing."""
    if not d.averaged:
        return ""
    told = f"The fit used readings averaged over {quantity(d.averaged, 's')}, since the log is so "
    if d.shortest:
        return (
            f"{told}long that shorter averages would take too much time. If a controller reacts faster than that, "
            "damping and delays may be biased: diagnose a shorter part of the log as well."
        )
    return f"{told}dense that this saves time and loses almost no information."
