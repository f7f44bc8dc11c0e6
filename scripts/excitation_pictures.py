"""A picture of the excitation designs: what each adds to the planes, and where its power is.

Needs the extra `render`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from auv_gym.channels import channel
from auv_gym.writing import replacing
from identification.pages.drawing import AFTER, INPUT, QUIET, STYLE, require_render
from scripts.excitation_table import DT, PLANES, Result, frequencies

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LOOKS: dict[str, str] = dict(zip(PLANES, (AFTER, INPUT)))
NAME = "excitation.png"
SHADE = "#f3f0e4"


def draw(results: Sequence[Result], band: tuple[float, float], folder: Path) -> Path:
    """Write the picture into a folder; where it lies.  Raises ImportError without matplotlib."""
    require_render()
    import matplotlib

    folder.mkdir(parents=True, exist_ok=True)
    with matplotlib.rc_context(STYLE):
        figure = sheet([r for r in results if r.signals], band)
        with replacing(folder / NAME) as new:
            figure.savefig(new, format="png", dpi=80, pil_kwargs={"optimize": True})
    return folder / NAME


def sheet(results: Sequence[Result], band: tuple[float, float]) -> Figure:
    """A row for each design: the signals of the first seed, and the spectra, means over the seeds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 1.25 * len(results) + 0.7), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.02, hspace=0.0)  # type: ignore[union-attr]
    cells = figure.subplots(len(results), 3, sharex="col", sharey="col", gridspec_kw={"width_ratios": (1, 1, 1.1)})
    cells = np.atleast_2d(cells)
    largest = max(float(power.max()) for r in results for power in r.spectra.values())
    peak = float(np.degrees(max(np.abs(values).max() for r in results for values in r.signals.values())))
    for result, (stern, bow, power) in zip(results, cells):
        for axes, name in zip((stern, bow), PLANES):
            if name in result.signals:
                values = np.degrees(result.signals[name])
                axes.step(DT * np.arange(values.size), values, where="post", color=LOOKS[name], linewidth=1.0)
            else:
                axes.text(0.5, 0.5, "left to the controller", transform=axes.transAxes, ha="center", color=QUIET)
            axes.set_yticks([-peak, 0.0, peak], [f"{value:.3g}" for value in (-peak, 0.0, peak)])
            axes.set_ylim(-1.2 * peak, 1.2 * peak)
        power.axvspan(*band, color=SHADE, zorder=0)
        for name, values in result.spectra.items():
            at = frequencies(2 * values.size)
            shown = np.where(values > 1e-9 * largest, np.degrees(1.0) ** 2 * values, np.nan)
            power.semilogx(at, shown, ".", markersize=3.0, color=LOOKS[name])
        power.set_yscale("log")
        power.set_ylim(1e-5 * largest * np.degrees(1.0) ** 2, 2.0 * largest * np.degrees(1.0) ** 2)
        stern.set_ylabel(result.design.name.replace(", ", ",\n"), rotation=0, ha="right", va="center")
    for axes, title in zip(
        cells[0],
        (
            *(f"added at the {channel(name).label}, deg" for name in PLANES),
            "power, deg² (shaded: the model's band)",
        ),
    ):
        axes.set_title(title, loc="left")
    for axes, label in zip(cells[-1], ("time, s", "time, s", "angular frequency, rad/s")):
        axes.set_xlabel(label)
    return figure
