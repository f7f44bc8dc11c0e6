"""The report of a diagnosis: one self-contained HTML file with its figures inside."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from auv_gym.channels import channel
from auv_gym.param import spec_at
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge.leftover import left_sentence, noise_sentence
from identification.diagnosis.judge.summary import dropped_sentence, slight_sentence, unsteady_sentence
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.search.bars import threshold
from identification.diagnosis.search.candidates import candidates_of
from identification.diagnosis.wording import typeset
from identification.experiments.kinds import KINDS
from identification.pages import diagnosis_figures, habitat_figure, residual_figures
from identification.pages.diagnosis_tables import (
    by_coefficient,
    coefficient_of,
    detectable_of,
    effect_of,
    in_order,
    rounds_of,
    ties_of,
    worded,
)
from identification.pages.drawing import require_render
from identification.pages.page import Drawing, amount, drawing, number, page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MEANINGS = {
    "none": "The refitted model agrees with this log.",
    "doubted": "The log itself looks wrong. The model cannot be judged until that is cleared up.",
    "coefficients": "The refitted model agrees with this log, but some coefficients differ from their given values.",
    "named": "The model is missing these effects, and unseen parts of the log confirm them.",
    "tied": "An effect is missing, but several causes would explain this log equally well.",
    "unexplained": "Log and model disagree, and no candidate effect of constant size explains the difference.",
}
# Key in the template, function, text for screen readers, caption.
PICTURES: tuple[tuple[str, Callable[[Diagnosis], Figure], str, str], ...] = (
    (
        "log",
        diagnosis_figures.log_figure,
        "Time series of {first}, inputs and context, with the windows of each part of the log shaded.",
        "The measured signals: outputs first, then inputs, then other signals. Shaded bands are the windows of the "
        "free runs; the shade alternates between parts of the log.",
    ),
    (
        "overview",
        diagnosis_figures.overview_figure,
        "Measured {first} over time with free runs of the model {model}, in every window.",
        "Free runs of the model, {model}, and the measured signal. The model restarts in each window, so every jump "
        "back to the measured line is the start of a new run.",
    ),
    (
        "zoom",
        diagnosis_figures.zoom_figure,
        "Measured {improved} and free runs of the model {model}, in single unseen windows.",
        "Single windows in close-up, with {improved} above {input}. The model was fitted and chosen without that part "
        "of the log. The grey seconds are used to fit the start of the run and are not scored.",
    ),
    (
        "growth",
        diagnosis_figures.growth_figure,
        "RMS error in unseen parts of the log against time since the window's start.",
        "Growth of the error during a free run in unseen parts of the log, over all windows. A lower and flatter line "
        "means a better model.",
    ),
    (
        "track",
        diagnosis_figures.track_figure,
        "Plan view of the measured track and of the model's free runs in unseen parts of the log.",
        "The measured track from above, north up, and free runs in unseen parts of the log.",
    ),
    (
        "residual",
        residual_figures.residual_figure,
        "Residual of {first} and of all other outputs over time.",
        "The residual: measured minus model, with starts fitted to whole windows. Noise jumps from sample to sample; "
        "slow waves and slopes {slow}.",
    ),
    (
        "habitat",
        habitat_figure.habitat_figure,
        "Where the residual is: shares of the squared error and of the samples, and its growth within a run.",
        "Where the remaining error is. The bars compare the share of the squared error with the share of the samples, "
        "by the quantity that it correlates with most. The line shows its growth during a free run.",
    ),
    (
        "autocorrelation",
        residual_figures.autocorrelation_figure,
        "Autocorrelation of the residual with the 95 % band of noise.",
        "Autocorrelation of the residual. Bars inside the grey band are compatible with white noise.",
    ),
    (
        "inputs",
        residual_figures.input_correlation_figure,
        "Correlation of the residual of {left} with each input at positive and negative lags.",
        "Correlation of the residual of {left} with the inputs. A clear peak right of zero points to a response to "
        "that input that the model does not have. A peak left of zero is due to feedback: the controller reacts to "
        "such errors.",
    ),
    (
        "correlate",
        residual_figures.correlate_figure,
        "Scatter of the residual's rate against the signal it correlates with most.",
        "The rate of change of the residual against the logged signal that it correlates with most. A slope or bend in "
        "the black line points to a cause; a flat line does not.",
    ),
)
GLOSSARY = {
    "free run": "A simulation of the model from one fitted initial state, driven by the logged inputs alone.",
    "window": "The stretch of the log that one free run covers.",
    "part": "One of up to six equal shares of the log. Each part is left out of the fit in turn.",
    "unseen": "Refers to a part of the log, and to a model that was fitted and chosen without that part. Unseen errors "
    "show how good a model is on new data.",
    "half of the log": "Any half of its parts. The choice among the fitted candidates is repeated with each half. An "
    "effect is kept only if most halves find something in its place.",
    "horizon": "The scored length of a free run: the window without the first seconds, to which its start is fitted.",
    "residual": "Measured minus model.",
    "coefficient": "A parameter that the model always has, such as yaw damping. Coefficients are refitted first.",
    "explained": "The share of the squared error of free runs, beyond the sensors' noise, that the effects remove. "
    "What remains is tested on the errors of one-step predictions, which show much smaller faults than free runs.",
    "effect": "A physical effect that the model may or may not have, such as a rudder offset.",
    "neutral": "The value of an effect at which it does nothing.",
    "evidence": "Twice the gain in log-likelihood from adding a candidate. A negative value means a worse model.",
    "cross-validated": "Evidence from predicting each part of the log with parameters fitted to the others, summed "
    "over the parts.",
    "probe": "The smallest change of an effect that is worth detecting.",
    "tied": "Explaining the log equally well, so that the log gives no reason to prefer one cause over the other.",
    "95 % interval": "The range that contains the true value with 95 % confidence, if this effect is the cause.",
    "noise floor": "The part of a residual that changes from sample to sample. No model can explain it.",
    "white": "Uncorrelated in time: one sample of the residual says nothing about the next.",
}


def diagnosis_page(diagnosis: Diagnosis, extras: Extras | None = None) -> str:
    """The report as the text of one self-contained HTML page.

    extras: collects pictures that cannot be drawn; the page says in their place which and why.  Raises ImportError,
    with the command to run, if the extra `render` is not installed.
    """
    require_render()
    return page("diagnosis.html", _content(diagnosis, extras or Extras()))


def _content(d: Diagnosis, extras: Extras) -> dict[str, Any]:
    plant = d.given.plant
    titles = _titles(d)
    source = d.source or str(d.record.attrs.get("source", "")) or "a record"
    return {
        "d": d,
        "source": source,
        "vehicle": plant.title or plant.name,
        "vehicle_name": plant.name,
        "vehicle_text": plant.description,
        "summary": [worded(text, {n: channel(n).label for n in d.record.names}) for text in d.paragraphs()],
        "meaning": MEANINGS[d.verdict],
        "figures": _figures(d, extras),
        "errors": _errors(d),
        "facts": _facts(d),
        "log": _log_facts(d),
        "remains": _remains(d),
        "rounds": rounds_of(d, titles),
        "bar": number(threshold(len(candidates_of(plant, d.record))), 2),
        "by_coefficient": by_coefficient(d, titles),
        "dropped": dropped_sentence(d),
        "parts": _parts(d),
        "windows": sum(len(part) for part in d.windows),
        "effects": [effect_of(d, e, titles) for e in d.effects],
        "alike": [effect_of(d, e, titles) for e in d.alike],
        "unsteady": unsteady_sentence(d),
        "slight": slight_sentence(d),
        "ties": ties_of(d, titles),
        "coefficients": [coefficient_of(c) for c in d.coefficients],
        "detectable": [detectable_of(d, x, titles) for x in in_order(d.detectable, plant)],
        "environment": KINDS.of(plant.family).environment if plant.family.kind in KINDS.names else "",
        "glossary": GLOSSARY,
        "changed": d.changed,
        "rest": _rest(d),
        "sensors": [m.text for m in d.sensors.mismatches] if d.sensors is not None else [],
        "compared": "; ".join(d.sensors.equations) if d.sensors is not None else "",
        "loops": [loop.words for loop in d.loops],
        "failures": [failure.text for failure in (*d.failures, *extras.failures)],
        "as_given_is_before": d.before is d.given,
        "only_refitted": d.after is d.refitted,
        "additions": "effects that the difference acts like" if d.alike and not d.effects else _additions(d),
    }


def _titles(d: Diagnosis) -> dict[str, str]:
    paths = [p for r in d.rounds for t in r.trials for p in t.candidate.paths]
    found = (*d.detectable, *d.coefficients, *d.added)  # added masses are not coefficients of the vehicle by themselves
    paths += [*d.given.plant.coefficients, *(x.path for x in found)]
    return {p: spec_at(d.given.plant, p).title or p for p in paths}


def _figures(d: Diagnosis, extras: Extras) -> dict[str, Drawing | None]:
    words = {
        "first": channel(d.after.every.channels[0]).label,
        "improved": channel(diagnosis_figures.most_improved(d)).label,
        "left": channel(residual_figures.least_explained(d)).label,
        "input": channel((*d.given.plant.family.required, *d.given.plant.inputs)[0]).label,
        "model": "before and after the diagnosis" if d.changed else "with its coefficients refitted",
        "slow": _slow_words(d),
    }
    missing = {
        "track": not {"north_m", "east_m"} <= set(d.after.unseen.channels),
        "inputs": not residual_figures.varying_inputs(d),
        "correlate": not residual_figures.correlated_outputs(d),
        "habitat": d.habitat is None or not d.habitat.shares,
    }
    made: dict[str, Drawing | None] = {}
    for key, draw, label, caption in PICTURES:
        made[key] = None
        if not missing.get(key, False):
            drawn = partial(diagnosis_figures.svg, draw, d, key, label.format(**words))
            picture = extras.attempt(f"The picture '{key}'", drawn, "")
            made[key] = drawing(picture, caption.format(**words)) if picture else None
    return made


def _slow_words(d: Diagnosis) -> str:
    """What slow waves and slopes of the residual mean, in words to follow them."""
    if not d.only_noise:
        return "show that the model is missing something"
    pushed = d.only_pushed or (d.noise is not None and bool(d.noise.swell))
    means = "come from process noise here" if pushed else "do not mean that anything is missing here"
    return f"{means}: one sample ahead, the model misses by noise alone"


def _errors(d: Diagnosis) -> list[dict[str, Any]]:
    """Rows by output: words, error of each stage in unseen parts, and the reduction from before to after."""
    refitted = "coefficients refitted"
    labels = {"before": refitted, "refitted": refitted, "after": f"with the {_additions(d)}"}
    rows = []
    for name, before in d.before.scores.items():
        unit, after = channel(name).unit, d.after.scores[name]
        stages = [(labels.get(label, label), stage.scores[name]) for label, stage in d.stages.items()]
        rows.append(
            {
                "name": d.after.unseen.label(name),
                "unit": amount(after.rmse, unit).partition(" ")[2],
                "before": amount(before.rmse, unit),
                "after": amount(after.rmse, unit),
                "stages": [
                    (label, amount(s.rmse, unit), amount(s.maximum, unit), f"{number(s.fit_percent)} %")
                    for label, s in stages
                ],
                "less": _less(before.rmse, after.rmse),
            }
        )
    return rows


def _additions(d: Diagnosis) -> str:
    """The difference between the vehicles before and after, in words."""
    return "named effects" if d.effects else "effects" if d.alike else "term found in the data"


def _less(before: float, after: float) -> str:
    share = 100.0 * (1.0 - after / before) if before > 0.0 else 0.0
    if abs(share) < 0.5:
        return "unchanged"
    return f"{abs(share):.0f} % {'less' if share > 0.0 else 'more'}"


def _rest(d: Diagnosis) -> list[str]:
    """Paragraphs on the unexplained error and on process noise."""
    said = [f"The log itself: {doubt.text}. What to do: {doubt.mend}." for doubt in d.doubts]
    if d.left:
        said.append(left_sentence(d).strip())
    if d.discovery is not None:
        said.append(d.discovery.summary())
    if d.habitat is not None:
        said.append(d.habitat.summary())
    random = noise_sentence(d)
    if random:
        said.append(random)
    return [typeset(text) for text in said]


def _facts(d: Diagnosis) -> list[tuple[str, str, str]]:
    """Value, words and remark of each key number other than the errors."""
    facts = [
        (
            _longest_run(d),
            "horizon",
            f"scored length of {'the longest' if d.given.plant.family.stepped else 'each'} free run",
        ),
        (str(sum(len(part) for part in d.windows)), "windows", f"free runs, in {_parts(d)} of the log"),
    ]
    if d.added:
        rest = "; random accelerations account for the rest" if d.only_pushed else ""
        facts.append((_explained(d), "explained", f"of the squared error of free runs above the sensors' noise{rest}"))
    return facts


def _explained(d: Diagnosis) -> str:
    """The share that the effects explain; all of it only if tests find nothing left."""
    share = f"{100.0 * max(d.explained, 0.0):.0f} %"
    return "> 99 %" if share == "100 %" and d.unexplained else share


def _parts(d: Diagnosis) -> str:
    return f"{len(d.windows)} parts" if len(d.windows) > 1 else "one part"


def _longest_run(d: Diagnosis) -> str:
    """Length of the longest scored free run with its unit."""
    scored, runs = d.after.unseen.scored, d.after.unseen
    time = d.record.time[runs.rows]
    longest = max(np.ptp(time[(runs.window == w) & scored]) for w in np.unique(runs.window[scored]))
    seconds = longest if d.given.plant.family.stepped else d.window - d.settle
    return f"{seconds:g} s" if seconds < 7200.0 else f"{seconds / 3600.0:.3g} h"


def _log_facts(d: Diagnosis) -> str:
    record, parts = d.record, len(d.record.segments)
    seconds = record.duration_s
    size, unit = (3600.0, "h") if seconds > 5.0 * 3600.0 else (60.0, "min") if seconds > 300.0 else (1.0, "s")
    text = f"{len(record):,} samples over {seconds / size:.3g} {unit}, "
    text += "evenly" if record.is_uniform() else "unevenly"
    text += f" spaced, {record.sample_interval:.3g} s apart" + ("" if record.is_uniform() else " in the median")
    text += f", in {parts} segments without gaps." if parts > 1 else ", without gaps."
    filled = {n: int(record.dataset[n].attrs.get("filled", 0)) for n in record.names}
    filled = {n: count for n, count in filled.items() if count}
    if filled:
        text += (
            " Missing samples were filled in: "
            + ", ".join(f"{c} of {channel(n).label}" for n, c in filled.items())
            + ("; fits count none of them." if not any(channel(n).held for n in filled) else ".")
        )
    if record.attrs.get("derived"):
        text += f" Derived, not measured: {record.attrs['derived']}."
    return text


def _remains(d: Diagnosis) -> list[tuple[str, str]]:
    """The words for each output, and a paragraph on its residual: size, noise floor, memory, correlations."""
    texts = []
    for name in d.after.fitted.channels:
        r, unit = d.remains[name], channel(name).unit
        text = f"The residual is {amount(r['rms'], unit)} RMS; the noise floor is {amount(r['noise_floor'], unit)}. "
        if r["resolution"] > 0.0:
            text += f"The sensor's resolution is {amount(r['resolution'], unit)}. "
        coloured = r["whiteness_p"] < 0.01
        if r["rms"] < 1.25 * r["noise_floor"]:
            text += "There is little left to explain. "
        elif coloured:
            text += "The error varies slowly"
            text += ", but one-step predictions leave only noise. " if d.only_noise else ": no effect describes it. "
        text += f"The correlation between neighbouring samples is {number(r['lag_1_correlation'], 2, sign=True)}, "
        text += "so the residual is not white. " if coloured else "and the residual is compatible with white noise. "
        strongest = next(iter(r["rate_correlates_with"].items()), None)
        if strongest:
            size, signal = abs(strongest[1]), residual_figures.signal_label(strongest[0]).partition(",")[0]
            words = "strongly" if size > 0.6 else "moderately" if size > 0.3 else "weakly"
            value = f"correlation {number(strongest[1], 2, sign=True)}"
            if size > residual_figures.CLEAR:
                text += f"Of all logged signals, its rate of change correlates most with {signal}, {words} ({value})."
            else:
                text += f"Its rate of change hardly correlates with any logged signal (most with {signal}: {value})."
        texts.append((d.after.fitted.label(name), text))
    return texts
