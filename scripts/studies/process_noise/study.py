"""Effects of process noise on fits and diagnoses, and its estimates, in simulated logs in open and closed loop.

    python -m scripts.studies.process_noise --seeds 50 --jobs 2 --out FOLDER
    python -m scripts.studies.process_noise --part 'clean: *' 'names: glider, *' --times 3 --out OTHER_FOLDER

Ornstein-Uhlenbeck accelerations push every velocity of the vehicle, in proportion to its spread, with correlation times
of 5 to 120 s. Their strength makes the free runs of the true model err by `times` the noise of the leading sensor. In
closed loop the controller acts on the sensors or, in the loop `exact`, on the true state, which no log shows. In open
loop the commands are those of a run without process noise. The vehicles are a glider's heading, a float's depth and two
torpedoes, one of which is unstable and has no open loop.

parameters: an effect of 5 to 10 standard errors and the coefficients, initially 10 % off, are fitted with process noise
and by free runs alone. The tables give the bias over the stated standard error (of an effect, away from neutral), the
coverage of 95 % intervals, and estimates of accelerations that alone add a tenth of a sensor's variance to free runs.
clean: diagnoses of the vehicle as it is.  names: diagnoses of a vehicle with one effect.
"""

from __future__ import annotations

from typing import Any

from scripts.studies.harness import Option, Study
from scripts.studies.process_noise.attempts import PARTS
from scripts.studies.process_noise.tables import CASES, sheets


def attempt(case: str, seed: int, times: float) -> dict[str, Any]:
    """The result of one log of a case such as `clean: glider, open`."""
    part, _, rest = case.partition(": ")
    family, _, loop = rest.partition(", ")
    return PARTS[part](family, seed, loop, times)


STUDY = Study(
    __doc__ or "",
    attempt,
    CASES,
    sheets,
    seeds=50,
    one_of="part",
    options={"times": Option(1.0, "free-run error of the true model over the sensor's noise", least=0.0)},
    doing="logs",
)
