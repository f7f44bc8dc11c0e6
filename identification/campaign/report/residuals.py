"""The residual tests of models in held-out runs on the page: autocorrelation, and correlation with inputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from auv_gym.channels import channel
from identification.campaign.report.wording import spread
from identification.compare.model_tests import is_white, strongest_input_correlation
from identification.pages.model_figures import residual_drawings
from identification.pages.page import Table, chance, number

MOST_MODELS = 6  # lines in one figure
_TEXT = (
    "Residuals on held-out runs: one-step prediction errors where the model has a noise model, simulation errors (free "
    "runs) otherwise. The prediction errors of an adequate model are white and uncorrelated with past inputs; "
    "simulation errors are rarely white."
)
_CAPTION = (
    "p: p-value of the Ljung-Box test for whiteness; residuals with p above 0.01 count as white. Strongest input: the "
    "input whose earlier samples correlate most with the residual, with the correlation relative to the 95 % noise "
    "bound."
)


def residual_content(fits: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Heading, words, table and figures of the residual tests; None without tests."""
    tests = {fit["name"]: fit["residuals"] for fit in fits if fit["residuals"]}
    if not tests:
        return None
    lines, white = [], 0
    for model, of in tests.items():
        for name, test in of.items():
            white += is_white(test)
            driver, size = strongest_input_correlation(test)
            tie = f"{channel(driver).label}, {number(size, 2)}" if driver else "–"
            of_what = "one sample ahead" if test["ahead"] else "free run"
            rms, first = spread([test["rms"]], name), number(test["correlation"][0], 2, sign=True)
            told = "yes" if is_white(test) else "no"
            lines.append([model, channel(name).label, of_what, tie, rms, first, chance(test["p_value"]), told])
    heads = ["model", "output", "residual", "strongest input", "RMS", "lag-1 correlation", "p", "white"]
    return {
        "heading": f"Residual tests: {white} of {len(lines)} model outputs white",
        "text": _TEXT,
        "table": Table(heads, lines, 4, _CAPTION),
        "drawings": residual_drawings(dict(list(tests.items())[:MOST_MODELS])),
    }
