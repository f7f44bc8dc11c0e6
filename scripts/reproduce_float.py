"""The comparison of Zhong et al. 2024 on a simulated float: RWLS, IVLS and LS-SVM, beside what works better.

    python -m scripts.reproduce_float --out figures

The field data are not published, so the float is the preset `qiandao_float` under the PID of `float_depth_pid`, sampled
as in the paper. White depth noise goes into the closed loop. The dive to 40 m and back to 0 m identifies, cut where it
comes near the surface, which equation (5) leaves out; all four dives are then run free from rest.

Source: Zhong, Yu, Bai, Zeng and Lian 2024, J. Ocean Eng. Sci. 9(4): section 4, tables 1 and 2, figures 4 to 7.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from math import inf, isfinite
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from auv_gym.model import Diverged, Model, simulate
from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from identification.estimate import Estimate
from identification.experiments.float_dives import depth_control
from identification.fit.greybox import GreyBox
from identification.fit.validation import score
from identification.kernel_machines.ls_svm import LsSvm
from identification.recursive.corrected_ivls import CorrectedIvls
from identification.recursive.diving_model import PARAMETERS
from identification.recursive.ivls import Ivls
from identification.recursive.refined_iv import RefinedIv
from identification.recursive.rwls import Rwls
from scripts.float_consistency import (
    LENGTHS,
    STUDIED,
    VARIANTS,
    Breakdown,
    bias,
    break_down,
    breakdown_rows,
    consistency_rows,
)

VEHICLE = "qiandao_float"
DEPTHS = (30, 40, 50, 60)  # m
TRAINING = 40  # m, of the dive that is fitted
RATES = {"dt": 1.0 / 1.43, "near": (0.8, 1.0 / 2.78)}  # s; closer where within 0.8 m of the target
START = 1.0  # m; at the surface the waterplane carries the float, which equation (5) leaves out
SURFACED = 0.5  # m; the dive that is fitted ends there
AT_REST = 5.0  # s over which the depth is read that a free run starts from
# a first guess that is wrong by a third and more, so that the grey box has something to find
GUESS = {"hull.drag_quadratic": 20.0, "hull.drag_linear": 3.0, "hull.piston_area": 1.5e-3}
FREE = (*GUESS, "effects.volume.offset")
WINDOW = 300.0  # s; the simulated float has no process noise, so long windows lose nothing
MEASURES = ("AVGAE", "RMSE", "R2", "MAXAE", "RMSE, true depth")
RMSE, R2, TRUE_RMSE = (MEASURES.index(name) for name in ("RMSE", "R2", "RMSE, true depth"))
NO_RUN = (inf, inf, -inf, inf, inf)  # of a model that was not found, or whose run leaves the finite numbers
PRINTED, CORRECTED, REFINED, GREY_BOX = "IVLS as printed", "IVLS corrected", "refined IV", "grey box"
RWLS, RWLS_OF_ONE, LS_SVM = "RWLS as printed", "RWLS, theta_1 = 1", "LS-SVM"
METHODS = (RWLS, RWLS_OF_ONE, LS_SVM, PRINTED, CORRECTED, REFINED, GREY_BOX)
# table 2: AVGAE m, RMSE m, R2, MAXAE m for 30, 40, 50 and 60 m
PUBLISHED = {
    "IVLS": (
        (1.756, 2.077, 0.950, 3.822), (2.388, 2.495, 0.965, 3.494), (1.024, 1.145, 0.995, 2.259),
        (0.553, 0.655, 0.999, 1.422),
    ),
    "RWLS": (
        (1.951, 2.391, 0.934, 4.598), (4.653, 4.962, 0.860, 6.972), (2.356, 2.603, 0.975, 4.197),
        (7.256, 8.950, 0.802, 15.547),
    ),
    "LS-SVM": (
        (2.406, 2.841, 0.907, 4.282), (3.097, 3.220, 0.941, 7.064), (1.741, 1.929, 0.986, 12.456),
        (8.782, 11.117, 0.695, 19.222),
    ),
}  # fmt: skip
# table 1: D/M, d/M, N3/M, N2/M, N1/M
PUBLISHED_PARAMETERS = {
    "IVLS": (3.95, 0.489, 0.0008, 0.0021, 0.1516),
    "RWLS": (0.6430, 0.1163, 0.0002, 0.0006, 0.0029),
    "LS-SVM": (0.0386, 0.0050, 0.00000, 0.00019, 0.00049),
}
IN_THE_PAPER = {RWLS: "RWLS", LS_SVM: "LS-SVM", PRINTED: "IVLS", CORRECTED: "IVLS"}


class Dive(NamedTuple):
    """A dive as recorded, and the depth that the float really had, m."""

    record: Record
    true_depth: np.ndarray


class Outcome(NamedTuple):
    """A method on one seed: MEASURES at each of DEPTHS, (4, 5); its parameters; why it found none, if so."""

    errors: np.ndarray
    estimates: tuple[Estimate, ...]
    problem: str


class Trial(NamedTuple):
    """One noise seed: the outcome of each method, and of each variant of the printed IVLS."""

    outcomes: Mapping[str, Outcome]
    breakdowns: Sequence[Breakdown]


class Study(NamedTuple):
    """All seeds; biases: relative errors of D/M, by (piston, method, number of samples), one for each seed."""

    noise: float
    trials: Sequence[Trial]
    biases: Mapping[tuple[str, str, int], Sequence[float]]

    def errors(self, method: str) -> np.ndarray:
        """MEASURES of a method, (seeds, depths, measures)."""
        return np.array([trial.outcomes[method].errors for trial in self.trials])


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison and the study of the bias, print their tables, draw them into a folder."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50, help="noise seeds of the comparison (default %(default)s)")
    parser.add_argument("--noise", type=float, default=0.02, help="depth noise, m, white (default %(default)s)")
    parser.add_argument(
        "--samples", type=int, default=LENGTHS[-1], help="longest record of the bias; 0: leave it out (%(default)s)"
    )
    parser.add_argument("--jobs", type=int, default=2, help="processes (default %(default)s)")
    parser.add_argument("--out", type=Path, help="folder for the pictures (PNG); default: no pictures")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON, in SI units")
    given = parser.parse_args(argv)
    written = []
    try:
        study = reproduce(given.seeds, given.noise, given.samples, given.jobs)
        if given.out is not None:
            from scripts.float_pictures import draw

            written = draw(study, given.out)
    except (ValueError, OSError, ImportError, Diverged) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps(as_json(study), indent=1))
    else:
        _print(study)
    for path in written:
        print(f"Written to {path}", file=sys.stderr)
    return 0


def reproduce(seeds: int, noise: float = 0.02, samples: int = LENGTHS[-1], jobs: int = 2) -> Study:
    """The comparison over noise seeds 0, 1, ..., and the bias over records of up to so many samples."""
    if seeds < 1 or jobs < 1 or not 0.0 <= noise < inf:
        raise ValueError(f"Needed --seeds and --jobs from 1, and --noise >= 0 m; got {seeds}, {jobs} and {noise:g}.")
    if samples and samples < LENGTHS[0]:
        raise ValueError(f"--samples needs {LENGTHS[0]} or more, or 0 to leave the bias out; got {samples}.")
    work: list[tuple[Callable[..., Any], tuple[Any, ...]]] = [(attempt, (seed, noise)) for seed in range(seeds)]
    if samples:
        work += [(bias, (load_vehicle(VEHICLE), *study, samples, noise)) for study in STUDIED]
    done = _all(work, jobs)
    biases: dict[tuple[str, str, int], list[float]] = {}
    for found in done[seeds:]:
        for key, value in found.items():
            biases.setdefault(key, []).append(value)
    return Study(noise, done[:seeds], biases)


def _all(work: Sequence[tuple[Callable[..., Any], tuple[Any, ...]]], jobs: int) -> list[Any]:
    """The results of all calls, in order, with a bar on stderr where that is a terminal."""
    errors = Console(stderr=True)
    with Progress(console=errors, transient=True, disable=not errors.is_terminal) as bars:
        task = bars.add_task("dives and fits", total=len(work))
        if jobs == 1:
            results = []
            for call, arguments in work:
                results.append(call(*arguments))
                bars.advance(task)
            return results
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        with ProcessPoolExecutor(jobs) as pool:
            futures = [pool.submit(call, *arguments) for call, arguments in work]
            for _ in as_completed(futures):
                bars.advance(task)
            return [future.result() for future in futures]


# One seed


def attempt(seed: int, noise: float) -> Trial:
    """The dives of one noise seed, fitted and run by every method."""
    dives = [dive(depth, seed, noise) for depth in DEPTHS]
    training = dives[DEPTHS.index(TRAINING)].record
    outcomes = {}
    for name, method in methods().items():
        try:
            fit = method.fit(training)
        except ValueError as error:
            outcomes[name] = Outcome(np.array([NO_RUN] * len(DEPTHS)), (), str(error))
            continue
        outcomes[name] = Outcome(np.array([measures(fit.model, d) for d in dives]), fit.estimates, "")
    known = {"least squares": methods()[RWLS_OF_ONE], "corrected": methods()[CORRECTED]}
    starts = {name: method.fit(training).theta for name, method in known.items()}
    last = dives[-1]
    breakdowns = [
        break_down(variant, starts, training, lambda model: measures(model, last)[RMSE]) for variant in VARIANTS
    ]
    return Trial(outcomes, breakdowns)


def dive(depth: int, seed: int, noise: float) -> Dive:
    """The dive to a depth, m; the one that is fitted also returns to 0 m, up to where it comes near the surface."""
    plant, rng = load_vehicle(VEHICLE), np.random.default_rng([seed, depth])
    there = 600.0 + 5.0 * (depth - DEPTHS[0])  # s: 300 to 450 to arrive, the rest to settle
    targets, hold = ([depth, 0.0], [there, there]) if depth == TRAINING else ([depth], [there])
    record = depth_control(plant, targets, rng=rng, hold=hold, noise=noise, start=START, **RATES)
    surfaced = np.flatnonzero((record.time > there) & (record["depth_m"] < SURFACED))
    if surfaced.size:
        record = record.between(0.0, float(record.time[surfaced[0]]))
    x = plant.initial(np.array([START, 0.0]))[None, :]
    return Dive(record, plant.run(record, record.segments, x)[:, 0])


def methods() -> dict[str, Any]:
    """The estimators that are compared, by name; the grey box starts from GUESS."""
    guessed = replace_at(load_vehicle(VEHICLE), GUESS)
    settings = (Rwls(), Rwls(known=("unity",)), LsSvm(), Ivls(), CorrectedIvls(), RefinedIv())
    return dict(zip(METHODS, (*settings, GreyBox(guessed, FREE, window=WINDOW))))


def measures(model: Model, dive: Dive) -> tuple[float, ...]:
    """MEASURES of a free run; without end where it leaves the finite numbers."""
    try:
        run = from_rest(model, dive.record)
    except Diverged:
        return NO_RUN
    measured = dive.record["depth_m"]
    with np.errstate(over="ignore", invalid="ignore"):  # a run may end just within the finite numbers
        found, true = score(measured, measured - run), score(dive.true_depth, dive.true_depth - run)
    values = (found.mean_absolute, found.rmse, found.r2, found.maximum, true.rmse)
    return values if all(map(isfinite, values)) else NO_RUN


def from_rest(model: Model, record: Record) -> np.ndarray:
    """Depths, m, of a free run from rest, at the depth that suits the first seconds; raises Diverged.

    The float hardly moves meanwhile, and one reading would carry its noise through the whole run. Below the surface no
    model here depends on the depth, so that a run may be shifted.
    """
    run, first = simulate(model, record)["depth_m"], record.time < AT_REST
    return run + np.mean(record["depth_m"][first] - run[first])


# What is printed


def comparison_rows(study: Study) -> list[list[str]]:
    """Table 2: depth, method, medians of MEASURES with the RMSE's range over seeds, and the paper's four figures."""
    rows = []
    for k, depth in enumerate(DEPTHS):
        for method in METHODS:
            errors = study.errors(method)[:, k]
            middle = [shown(value) for value in np.median(errors, axis=0)]
            spread = f"{shown(errors[:, RMSE].min())} to {shown(errors[:, RMSE].max())}"
            paper = IN_THE_PAPER.get(method)
            printed = ", ".join(f"{v:.3f}" for v in PUBLISHED[paper][k]) if paper else ""
            rows.append([f"{depth} m", method, *middle[:4], spread, middle[4], printed])
    return rows


COMPARISON_HEAD = ("dive", "method", *MEASURES[:4], "RMSE, range", MEASURES[4], "paper: AVGAE, RMSE, R2, MAXAE")


def parameter_rows(study: Study) -> list[list[str]]:
    """Table 1: medians over seeds of each parameter and of half its 95 % interval, beside the paper's values."""
    rows = []
    for method in METHODS[:-1]:
        found = [trial.outcomes[method].estimates[1:] for trial in study.trials if trial.outcomes[method].estimates]
        cells = []
        for i in range(len(PARAMETERS) - 1 if found else 0):
            value = np.median([estimates[i].value for estimates in found])
            half = np.median([estimates[i].ci95[1] - estimates[i].value for estimates in found])
            cells.append(f"{value:.3g} ± {half:.2g}" if isfinite(half) else f"{value:.3g}")
        rows.append([method, *cells])
    rows += [[f"paper: {name}", *(f"{v:g}" for v in values)] for name, values in PUBLISHED_PARAMETERS.items()]
    return rows


def grey_box_rows(study: Study) -> list[list[str]]:
    """Each parameter of the grey box: truth, first guess, median and half its interval, intervals with the truth."""
    plant, rows = load_vehicle(VEHICLE), []
    fits = [trial.outcomes[GREY_BOX].estimates for trial in study.trials if trial.outcomes[GREY_BOX].estimates]
    for i, path in enumerate(FREE):
        truth, found = float(value_at(plant, path)), [fit[i] for fit in fits]
        value, half = np.median([e.value for e in found]), np.median([e.ci95[1] - e.value for e in found])
        held = sum(e.ci95[0] <= truth <= e.ci95[1] for e in found)
        unit = found[0].unit if found else ""
        cells = [f"{truth:g}", f"{GUESS.get(path, 0.0):g}", f"{value:.4g} ± {half:.2g}", f"{held} of {len(found)}"]
        rows.append([path, unit, *cells])
    return rows


def count_rows(study: Study) -> list[list[str]]:
    """In how many seeds a statement holds at all four depths."""
    found = {method: study.errors(method) for method in METHODS}

    def below(one: str, other: str, factor: float = 1.0, measure: int = RMSE) -> int:
        return int(np.all(found[one][..., measure] <= factor * found[other][..., measure], axis=1).sum())

    counts = {
        f"{CORRECTED}: RMSE below {RWLS}": below(CORRECTED, RWLS),
        f"{CORRECTED}: RMSE below {RWLS_OF_ONE}": below(CORRECTED, RWLS_OF_ONE),
        f"{CORRECTED}: RMSE below {LS_SVM}": below(CORRECTED, LS_SVM),
        f"{CORRECTED}: R2 at least 0.95": int(np.all(found[CORRECTED][..., R2] >= 0.95, axis=1).sum()),
        f"{GREY_BOX}: RMSE at most half of {CORRECTED}": below(GREY_BOX, CORRECTED, 0.5),
        f"{GREY_BOX}: the same, against the true depth": below(GREY_BOX, CORRECTED, 0.5, TRUE_RMSE),
        f"{PRINTED}: RMSE below {RWLS}": below(PRINTED, RWLS),
        f"{PRINTED}: RMSE below {LS_SVM}": below(PRINTED, LS_SVM),
        f"{PRINTED}: its instrument leaves the finite numbers": sum(
            bool(trial.outcomes[PRINTED].problem) for trial in study.trials
        ),
    }
    return [[text, f"{count} of {len(study.trials)}"] for text, count in counts.items()]


def shown(value: float) -> str:
    """A figure of a table: three decimals, fewer of what is large, a word for a model or a run that was lost."""
    if not isfinite(value):
        return "lost"
    return f"{value:.3f}" if abs(value) < 100.0 else f"{value:.0f}" if abs(value) < 1e4 else f"{value:.0e}"


def as_json(study: Study) -> dict[str, Any]:
    """Everything that was measured, seed by seed; null where a method gave nothing."""

    def plain(values: Any) -> Any:
        if isinstance(values, (list, tuple, np.ndarray)):
            return [plain(value) for value in values]
        return float(values) if isfinite(values) else None

    return {
        "depth_noise_m": study.noise,
        "depths_m": DEPTHS,
        "measures": MEASURES,
        "errors": {method: plain(study.errors(method)) for method in METHODS},
        "parameters": {
            method: [
                {
                    e.path: {"value": e.value, "ci95": plain(e.ci95), "unit": e.unit}
                    for e in t.outcomes[method].estimates
                }
                for t in study.trials
            ]
            for method in METHODS
        },
        "problems": {m: [t.outcomes[m].problem for t in study.trials if t.outcomes[m].problem] for m in METHODS},
        "counts": dict(count_rows(study)),
        "breakdowns": {
            variant.name: [dict(zip(Breakdown._fields, plain(t.breakdowns[i]))) for t in study.trials]
            for i, variant in enumerate(VARIANTS)
        },
        "bias_of_damping": [
            {"piston": piston, "method": method, "samples": n, "relative_errors": plain(values)}
            for (piston, method, n), values in study.biases.items()
        ],
    }


def _print(study: Study) -> None:
    # without a terminal a console takes 80 columns for granted, and would break what is piped to a file
    console, seeds = Console(highlight=False, width=max(Console().width, 144)), len(study.trials)
    told = f"{seeds} seeds, {study.noise:g} m of white depth noise"
    _table(console, f"Table 2: errors of free runs, m; medians over {told}", COMPARISON_HEAD, comparison_rows(study))
    _table(console, "Seeds in which it is so at all four depths", ("statement", "seeds"), count_rows(study))
    symbols = ("method", "D/M, 1/s", "d/M, m/s2", "N3/M, 1/s", "N2/M, 1/(m s2)", "N1/M, 1/s2")
    _table(console, "Table 1: parameters ± half of their 95 % intervals, medians", symbols, parameter_rows(study))
    head = ("grey box", "unit", "truth", "first guess", "found", "intervals that hold the truth")
    _table(console, "", head, grey_box_rows(study))
    _table(console, "Where IVLS as printed breaks; medians", *breakdown_rows([t.breakdowns for t in study.trials]))
    if study.biases:
        _table(console, "Error of D/M, %: median (range) over seeds", *consistency_rows(study.biases))


def _table(console: Console, title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    table = Table(title=title or None, title_justify="left", box=SIMPLE_HEAD)
    for i, name in enumerate(head):
        table.add_column(name, justify="left" if i == 0 or name == "method" else "right")
    for row in rows:
        table.add_row(*row)
    console.print(table)


if __name__ == "__main__":
    sys.exit(main())
