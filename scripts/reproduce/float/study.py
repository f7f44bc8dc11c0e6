"""The comparison of Zhong et al. 2024 on a simulated float: RWLS, IVLS and LS-SVM, and methods that work better.

    python -m scripts.reproduce.float --seeds 50 --jobs 2 --out float
    python -m scripts.reproduce.float --seeds 2 --case dives

The field data are not published, so the float is the preset `qiandao_float` under the PID of `float_depth_pid`, sampled
as in the paper. White depth noise enters the closed loop. Models are identified from the dive to 40 m and back to 0 m,
cut near the surface, which equation (5) does not cover. All four dives are then run free from rest. The cases called
bias use long records of a float that obeys equation (5), with eight seeds of their own.

Source: Zhong, Yu, Bai, Zeng and Lian 2024, J. Ocean Eng. Sci. 9(4): section 4, tables 1 and 2, figures 4 to 7.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from auv_gym.plant import load_vehicle
from scripts.reproduce.float.consistency import FEEDBACK, LENGTHS, PLANNED, bias
from scripts.reproduce.float.dives import DEPTHS, VEHICLE, compared
from scripts.reproduce.float.pictures import ORDER, runs_of, summary, typical_seed
from scripts.reproduce.float.tables import BIAS, DIVES, Comparison, sheets
from scripts.studies.harness import Found, Option, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BIAS_SEEDS = range(8)


def attempt(case: str, seed: int, noise: float, samples: int) -> dict[str, Any]:
    """The comparison for a noise seed; or relative errors of D/M by method and number of samples, up to `samples`."""
    if case == DIVES:
        return compared(seed, noise)
    return bias(load_vehicle(VEHICLE), seed, case.removeprefix(BIAS), samples, noise)


def pictures(found: Found) -> dict[str, Callable[[], Figure]]:
    """The deepest dive of a typical seed, and the bias."""
    of = Comparison.of(found)
    if not of.trials:
        return {}
    seed = list(found.runs[DIVES])[typical_seed(of)]
    shown = dict(zip(ORDER, runs_of(seed, of.noise)))
    return {"recursive.png": lambda: summary(of, shown[DEPTHS[-1]])}


def seeds_of(case: str, seeds: Sequence[int]) -> Sequence[int]:
    return seeds if case == DIVES else BIAS_SEEDS


STUDY = Study(
    __doc__ or "",
    attempt,
    (DIVES, BIAS + PLANNED, BIAS + FEEDBACK),
    sheets,
    seeds=50,
    seeds_of=seeds_of,
    options={
        "noise": Option(0.02, "depth noise, m, white", least=0.0),
        "samples": Option(LENGTHS[-1], "longest record of the bias", least=LENGTHS[0]),
    },
    pictures=pictures,
    doing="dives and fits",
)
