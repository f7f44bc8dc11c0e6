"""Tables of the comparison beside those of the paper, of the failure of IVLS, and of the bias."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from typing import Any

import numpy as np

from auv_gym.param import value_at
from auv_gym.plant import load_vehicle
from identification.recursive.diving_model import PARAMETERS
from scripts.reproduce.float.consistency import breakdown_rows, consistency_rows
from scripts.reproduce.float.dives import (
    CORRECTED,
    DEPTHS,
    FREE,
    GREY_BOX,
    GUESS,
    LS_SVM,
    MEASURES,
    METHODS,
    PRINTED,
    R2,
    RMSE,
    RWLS,
    RWLS_OF_ONE,
    TRUE_RMSE,
    VEHICLE,
)
from scripts.studies.harness import Found, Sheet

DIVES = "dives"
BIAS = "bias, "  # followed by the motion of the piston
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


@dataclass(frozen=True)
class Comparison:
    """All seeds; biases: relative errors of D/M, by (piston, method, number of samples), one for each seed."""

    noise: float
    trials: Sequence[Mapping[str, Any]]
    biases: Mapping[tuple[str, str, int], Sequence[float]]

    @classmethod
    def of(cls, found: Found) -> Comparison:
        biases: dict[tuple[str, str, int], list[float]] = {}
        for case in found.runs:
            for run in found.of(case) if case.startswith(BIAS) else ():
                for method, by_length in run.items():
                    for samples, error in by_length.items():
                        biases.setdefault((case.removeprefix(BIAS), method, int(samples)), []).append(error)
        return cls(found.options["noise"], found.of(DIVES), biases)

    def errors(self, method: str) -> np.ndarray:
        """MEASURES of a method, (seeds, depths, measures)."""
        return np.array([trial["outcomes"][method]["errors"] for trial in self.trials])

    def estimates(self, method: str) -> list[Any]:
        """The parameters of a method in the seeds in which it found a model."""
        return [of["estimates"] for of in (t["outcomes"][method] for t in self.trials) if of["estimates"]]


def comparison_rows(of: Comparison) -> list[list[str]]:
    """Table 2: depth, method, medians of MEASURES with the RMSE's range over seeds, and the paper's four figures."""
    rows = []
    for k, depth in enumerate(DEPTHS):
        for method in METHODS:
            errors = of.errors(method)[:, k]
            middle = [shown(value) for value in np.median(errors, axis=0)]
            spread = f"{shown(errors[:, RMSE].min())} to {shown(errors[:, RMSE].max())}"
            paper = IN_THE_PAPER.get(method)
            printed = ", ".join(f"{v:.3f}" for v in PUBLISHED[paper][k]) if paper else ""
            rows.append([f"{depth} m", method, *middle[:4], spread, middle[4], printed])
    return rows


COMPARISON_HEAD = ("dive", "method", *MEASURES[:4], "RMSE, range", MEASURES[4], "paper: AVGAE, RMSE, R2, MAXAE")


def parameter_rows(of: Comparison) -> list[list[str]]:
    """Table 1: medians over seeds of each parameter and of half its 95 % interval, beside the paper's values."""
    rows = []
    for method in METHODS[:-1]:
        found = [estimates[1:] for estimates in of.estimates(method)]
        middles = [_middle([estimates[i] for estimates in found]) for i in range(len(PARAMETERS) - 1 if found else 0)]
        rows.append([method, *(f"{v:.3g} ± {half:.2g}" if isfinite(half) else f"{v:.3g}" for v, half in middles)])
    rows += [[f"paper: {name}", *(f"{v:g}" for v in values)] for name, values in PUBLISHED_PARAMETERS.items()]
    return rows


def grey_box_rows(of: Comparison) -> list[list[str]]:
    """Each parameter of the grey box: truth, first guess, median and half-width, share of intervals with the truth."""
    plant, rows = load_vehicle(VEHICLE), []
    fits = of.estimates(GREY_BOX)
    for i, path in enumerate(FREE):
        truth, found = float(value_at(plant, path)), [fit[i] for fit in fits]
        value, half = _middle(found)
        held = sum(e["ci95"][0] <= truth <= e["ci95"][1] for e in found)
        cells = [f"{truth:g}", f"{GUESS.get(path, 0.0):g}", f"{value:.4g} ± {half:.2g}", f"{held} of {len(found)}"]
        rows.append([path, found[0]["unit"] if found else "", *cells])
    return rows


def _middle(found: Sequence[Mapping[str, Any]]) -> tuple[float, float]:
    """Medians of the values and of half their intervals."""
    return float(np.median([e["value"] for e in found])), float(np.median([e["ci95"][1] - e["value"] for e in found]))


def count_rows(of: Comparison) -> list[list[str]]:
    """The number of seeds in which a statement holds at all four depths."""
    found = {method: of.errors(method) for method in METHODS}

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
            bool(trial["outcomes"][PRINTED]["problem"]) for trial in of.trials
        ),
    }
    return [[text, f"{count} of {len(of.trials)}"] for text, count in counts.items()]


def shown(value: float) -> str:
    """A number of a table: three decimals, fewer if it is large, a word for a failed fit or run."""
    if not isfinite(value):
        return "lost"
    return f"{value:.3f}" if abs(value) < 100.0 else f"{value:.0f}" if abs(value) < 1e4 else f"{value:.0e}"


def sheets(found: Found) -> list[Sheet]:
    """Tables 1 and 2, counts of seeds, the grey box, the failure of IVLS, and the bias."""
    of, made = Comparison.of(found), []

    def sheet(name: str, title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
        heads = [text if number == 0 or text == "method" else f"{text}>" for number, text in enumerate(head)]
        made.append(Sheet(name, title, heads, rows))

    if of.trials:
        told = f"{len(of.trials)} seeds, {of.noise:g} m of white depth noise"
        sheet("table_2", f"Table 2: errors of free runs, m; medians over {told}", COMPARISON_HEAD, comparison_rows(of))
        sheet("counts", "Seeds in which it is so at all four depths", ("statement", "seeds"), count_rows(of))
        symbols = ("method", "D/M, 1/s", "d/M, m/s2", "N3/M, 1/s", "N2/M, 1/(m s2)", "N1/M, 1/s2")
        sheet("table_1", "Table 1: parameters ± half of their 95 % intervals, medians", symbols, parameter_rows(of))
        head = ("grey box", "unit", "truth", "first guess", "found", "intervals that hold the truth")
        sheet("grey_box", "Parameters of the grey box", head, grey_box_rows(of))
        breaks = breakdown_rows([trial["breakdowns"] for trial in of.trials])
        sheet("breakdowns", "Where IVLS as printed breaks; medians", *breaks)
    if of.biases:
        sheet("bias", "Error of D/M, %: median (range) over seeds", *consistency_rows(of.biases))
    return made
