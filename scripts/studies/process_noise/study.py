"""What process noise does to fits and diagnoses, and what is known of it: simulated logs, open and closed loop.

    python -m scripts.studies.process_noise --seeds 50 --jobs 2 --out FOLDER
    python -m scripts.studies.process_noise --part 'clean: *' 'names: glider, *' --times 3 --out OTHER_FOLDER

Ornstein-Uhlenbeck accelerations push every velocity of the vehicle, with correlation times of 5 to 120 s, in proportion
to how much it varies, and as strongly as makes the true model's free runs err by `times` the noise of the leading
sensor. In closed loop the controller steers against them, by what the sensors say, or, in the loop `exact`, by the true
state, which no log shows; in open loop the commands are those of a run without them. Four families: a glider's heading,
a float's depth, two torpedoes; the one that is unstable by itself has no open loop.

parameters: an effect of 5 to 10 standard errors and the coefficients, 10 % off at first, fitted with process noise and
by free runs alone; bias over the stated standard error (of an effect away from neutral), coverage of 95 % intervals,
and the process noise found, of accelerations that add a tenth of a sensor's variance to free runs by themselves.
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
