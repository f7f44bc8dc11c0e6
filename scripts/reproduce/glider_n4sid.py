"""N4SID on the pool log of a glider at -15 deg of rudder, cross-validated at -30 deg, compared with other methods.

    python -m scripts.reproduce.glider_n4sid --seeds 50 --jobs 2 --out glider_n4sid

The logs are not published. The vehicle is the preset `ganeshblue_corrected`, equation (15), which has no rudder lag. A
log has 30 s of zero rudder and 120 s at one angle. A compass reads the heading once a second, with white noise, to
0.1 deg, within half a turn of north; the turn passes through south. No ramp is straightened. The zeros are needed: a
horizon of h samples needs 2 h samples before the step, so that each future input occurs on either side of it.

Source: Putri, Latifa, Trilaksono and Hidayat, "Modelling and Identification of Underwater Glider for Heading Angle
Correction": section IV, figures 6 to 8 and 10 and 11.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, radians
from typing import Any, Literal, NamedTuple

import numpy as np

from auv_gym.channels import wrap
from auv_gym.model import Model, simulate
from auv_gym.models.linear import StateSpace, linearise
from auv_gym.plant import Plant, load_vehicle
from auv_gym.records.record import Record
from identification.compare.comparison import OpenLoop, compare_open
from identification.fit.validation import score
from identification.identified import split
from identification.linear.polynomials.armax import Armax
from identification.linear.polynomials.output_error import OutputError
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.subspaces.pbsid import Pbsid
from scripts.studies.harness import Found, Option, Sheet, Study

ANALYTIC, CORRECTED = "ganeshblue", "ganeshblue_corrected"  # equations (14) and (15)
RUDDER, HEADING, RATE = ("rudder_rad",), ("heading_rad",), ("r_radps",)
PUBLISHED = 94.61  # %, of the cross-check
TRAINING_DEG, CROSS_DEG = -15, -30
ANGLES_DEG = (TRAINING_DEG, CROSS_DEG, 15, 30)  # of the rudder in the logs to judge by
LEAD, TURN = 30.0, 120.0  # s at zero rudder, s at its angle; the turn, as 0.5 deg of noise leaves 95.3 % at -15 deg
DT = 1.0  # s, of the preset; compasses of gliders log once in one to a few seconds
NOISE_DEG, RESOLUTION_DEG = 0.5, 0.1
START_DEG = 165.0  # of the compass, on the side from which the turn goes through south
TRUTH, BARE, SCALED = "vehicle itself (15)", "analytic (14)", "(14) with N4SID's turn"
N4SID, REFINED = "N4SID", "N4SID, refined"
PLAIN, PLAIN_REFINED, PLAIN_PBSID = "N4SID by default", "N4SID by default, refined", "PBSID by default"
TWO_THIRDS, UNAWARE = "default, 2/3 of the log", "poles and drift free"
GIVEN = (TRUTH, BARE, SCALED)


@dataclass(frozen=True)
class Method:
    """An estimator and its data.

    form: heading relative to its mean at zero rudder ("rest"), as the compass reads it ("compass"), or its rate, by
    differences, whose model is then integrated ("rate").  both: whether a log at +15 deg is fitted, too.  part: whether
    the last third is held out, as `auv-gym identify` does without other data to judge by.
    """

    estimator: Any
    form: Literal["rest", "compass", "rate"] = "rest"
    both: bool = False
    part: bool = False

    def fit(self, logs: Sequence[Record]) -> StateSpace | Model:
        """The model of heading; raises ValueError if the data do not determine it."""
        records = [_FORMS[self.form](log) for log in (logs if self.both else logs[:1])]
        records = split(records)[0] if self.part else records
        model = self.estimator.fit(*records).model
        return heading_of(model) if self.form == "rate" else model


# The defaults depend on the log; beside them N4SID with manual settings, and in the second table without each of them.
# Rest: at zero rudder the heading stays. Estimated from 30 s, that rate is wrong by several percent of the turn, twice
# as much at +15 deg; and as no pole is found at exactly 1, a heading counted from north drifts in proportion to it.
# Memory: a sensor's noise on an integrator is predicted best from all of the past, so the horizon is as long as the
# log allows. Weights: CVA's divide by the spread of the future, which here is the ramp.
_N4SID = N4sid(RUDDER, HEADING, order=2, horizon=15, weight="n4sid", integrators=0, offset=False)
_PLAIN = N4sid(RUDDER, HEADING)
_RATE = replace(_N4SID, outputs=RATE, horizon=14)  # the longest for a log that is a sample shorter
_INTEGRATING: dict[str, Any] = {"n_a": 1, "n_b": 1, "integrating": HEADING, "offset": False}
METHODS = {
    N4SID: Method(_N4SID),
    REFINED: Method(replace(_N4SID, refine=True)),
    PLAIN: Method(_PLAIN, "compass"),
    PLAIN_REFINED: Method(replace(_PLAIN, refine=True), "compass"),
    PLAIN_PBSID: Method(Pbsid(RUDDER, HEADING), "compass"),
    "ARMAX, integrating": Method(Armax(RUDDER, HEADING, n_c=1, **_INTEGRATING)),
    "output error, integrating": Method(OutputError(RUDDER, HEADING, **_INTEGRATING)),
}
SETTINGS = {
    TWO_THIRDS: Method(_PLAIN, "compass", part=True),
    UNAWARE: Method(replace(_PLAIN, integrators=0, offset=True), "compass"),
    "a pole at 1, drift free": Method(replace(_PLAIN, integrators=1, offset=True), "compass"),
    "MOESP's weights": Method(replace(_N4SID, weight="moesp")),
    "CVA's weights": Method(replace(_N4SID, weight="cva")),
    "horizon 10": Method(replace(_N4SID, horizon=10)),
    "horizon 5": Method(replace(_N4SID, horizon=5)),
    "order 1": Method(replace(_N4SID, order=1)),
    "heading from north": Method(_N4SID, "compass"),
    "operating point estimated": Method(replace(_N4SID, offset=True)),
    "the same, both signs": Method(replace(_N4SID, offset=True), both=True),
    "both signs": Method(_N4SID, both=True),
    "rate, order 1": Method(replace(_RATE, order=1), "rate"),
    "rate, order 2": Method(_RATE, "rate"),
}
ALL = (*GIVEN, *METHODS, *SETTINGS)


class PoolLog(NamedTuple):
    """A log as read, and the true turn of the vehicle, rad, at its times."""

    record: Record
    turn: np.ndarray


# One seed


def attempt(case: str, seed: int, noise: float) -> dict[str, dict[str, Any]]:
    """All models of one noise seed, judged on held-out logs; noise: deg.

    By model, fits of free runs, %, and reasons of failures.  fits: over the logs of ANGLES_DEG as read.  true: the same
    for the heading without noise.  training: over the fitted log.  -inf if there is no model or it diverges.
    """
    training, judging = training_logs(seed, radians(noise)), judging_logs(seed, radians(noise))
    models, problems = models_of(training, METHODS | SETTINGS)
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in ALL}
    for log in (training[0], *judging):
        run = free_runs(models, log.record)
        problems |= run.failed
        for name, values in found.items():
            values.append(_fits(run, name, log.turn))
    return {
        "fits": {name: [fit for fit, _ in values[1:]] for name, values in found.items()},
        "true": {name: [fit for _, fit in values[1:]] for name, values in found.items()},
        "training": {name: values[0][0] for name, values in found.items()},
        "problems": problems,
    }


def training_logs(seed: int, noise: float) -> list[PoolLog]:
    """The log at -15 deg, and that at +15 deg for the methods that use both."""
    return [pool_log(angle, noise, np.random.default_rng([seed, 0, angle % 360])) for angle in (TRAINING_DEG, 15)]


def judging_logs(seed: int, noise: float) -> list[PoolLog]:
    """A log at each of ANGLES_DEG, with noise of its own."""
    return [pool_log(angle, noise, np.random.default_rng([seed, 1, angle % 360])) for angle in ANGLES_DEG]


def pool_log(angle_deg: int, noise: float, rng: np.random.Generator) -> PoolLog:
    """A run at rest until the rudder is put over, from a heading from which it turns through south; noise: rad."""
    run = pool_run(load_vehicle(CORRECTED, dt=DT), radians(angle_deg), TURN)
    before = np.zeros(round(LEAD / DT))
    turn = np.concatenate([before, run[HEADING[0]]])
    start = -np.sign(angle_deg) * radians(START_DEG)
    columns = {
        RUDDER[0]: np.concatenate([before, run[RUDDER[0]]]),
        HEADING[0]: read(start + turn, noise, rng),
    }
    return PoolLog(Record.from_arrays(DT * np.arange(turn.size), columns), turn)


def pool_run(plant: Plant, rudder: float, duration: float) -> Record:
    """A run at constant rudder, rad, from straight ahead at heading zero."""
    time = np.arange(0.0, duration + 0.5 * plant.dt, plant.dt)
    at_rest = dict.fromkeys(plant.outputs, np.zeros(time.size))
    return simulate(plant, Record.from_arrays(time, {**at_rest, "rudder_rad": np.full(time.size, rudder)}))


def read(heading: np.ndarray, noise: float, rng: np.random.Generator) -> np.ndarray:
    """Readings of a compass, rad: with noise, resolution, and wrapped to half a turn of north."""
    step = radians(RESOLUTION_DEG)
    return wrap(step * np.round((heading + noise * rng.standard_normal(heading.size)) / step))


def models_of(training: Sequence[PoolLog], methods: Mapping[str, Method]) -> tuple[dict[str, Model], dict[str, str]]:
    """The models by name, including N4SID's and those of GIVEN, and the reasons of failed methods."""
    models: dict[str, Model] = {}
    problems: dict[str, str] = {}
    for name, method in ({N4SID: METHODS[N4SID]} | dict(methods)).items():
        try:
            models[name] = method.fit([log.record for log in training])
        except ValueError as error:
            problems[name] = str(error)
    analytic = linearise(load_vehicle(ANALYTIC, dt=DT))
    models |= {TRUTH: linearise(load_vehicle(CORRECTED, dt=DT)), BARE: analytic}
    if N4SID in models:
        ratio = turn_per_rudder(models[N4SID]) / turn_per_rudder(analytic)
        models[SCALED] = replace(analytic, b=ratio * analytic.b)
    else:
        problems[SCALED] = problems[N4SID]
    return models, problems


def turn_per_rudder(model: Any) -> float:
    """Mean turning rate over a log at -15 deg, from rest, per rudder angle, 1/s."""
    time, rudder = DT * np.arange(round(TURN / DT) + 1), radians(TRAINING_DEG)
    record = Record.from_arrays(time, {RUDDER[0]: np.full(time.size, rudder)})
    heading = model.run(record, record.segments, np.zeros((1, len(model.states))))[:, 0]
    return float((heading[-1] - heading[0]) / TURN / rudder)


def heading_of(rate: StateSpace) -> StateSpace:
    """The model of heading whose differences over a sample are the rates of a model that is at rest without input."""
    a, b, c, dt = rate.a, rate.b, rate.c, rate.dt
    return StateSpace(
        a=np.block([[a, np.zeros((len(a), 1))], [dt * c @ a, np.ones((1, 1))]]),
        b=np.vstack([b, dt * c @ b]),
        c=np.eye(1, len(a) + 1, len(a)),
        inputs=rate.inputs,
        outputs=HEADING,
        dt=dt,
    )


def free_runs(models: Mapping[str, Model], log: Record) -> OpenLoop:
    """Free runs of all models over a log, with starts fitted while the rudder is at zero, which is not scored."""
    absolute = {name for name, method in (METHODS | SETTINGS).items() if method.form == "compass"}
    rest = {name: model for name, model in models.items() if name not in absolute}
    found = compare_open(rest, from_rest(log), settle=LEAD)
    others = {name: model for name, model in models.items() if name in absolute}
    if not others:
        return found
    more = compare_open(others, log, settle=LEAD)
    return replace(found, runs=found.runs | more.runs, failed=found.failed | more.failed)


def from_rest(log: Record) -> Record:
    """The log with heading relative to its mean before the step."""
    heading = log[HEADING[0]]
    return log.with_channels({HEADING[0]: heading - heading[log.time < LEAD].mean()})


def differences(log: Record) -> Record:
    """The log with the rate of heading over the last sample."""
    rate = np.diff(log[HEADING[0]]) / DT
    return Record.from_arrays(log.time[1:], {RUDDER[0]: log[RUDDER[0]][1:], RATE[0]: rate})


_FORMS = {"rest": from_rest, "compass": lambda log: log, "rate": differences}


def _fits(run: OpenLoop, name: str, turn: np.ndarray) -> tuple[float, float]:
    """Fit, %, of the readings and of the heading without their noise, each about its own mean before the step."""
    if name not in run.runs:
        return -inf, -inf
    found = run.runs[name]
    kept = found.scored
    modelled = found.model[:, 0] - found.model[~kept, 0].mean()
    return (
        found.scores(run.record)[HEADING[0]].fit_percent,
        score(turn[kept], (turn - modelled)[kept]).fit_percent,
    )


# What is printed

CROSS = ANGLES_DEG.index(CROSS_DEG)
CASE = "pool logs"


def sheets(found: Found) -> list[Sheet]:
    """Fits by method and log, and of N4SID with other settings; in a file, every fit."""
    trials = found.runs[CASE]
    what = f"{len(trials)} seeds), compass noise {found.options['noise']:g} deg; true: without it"
    title = f"N4SID with other settings; reached: {PUBLISHED:g} % and more at {CROSS_DEG} deg"
    every = [
        [str(seed), name, kind, *(f"{fit:.4f}" for fit in trial[kind][name])]
        for seed, trial in trials.items()
        for name in ALL
        for kind in ("fits", "true")
    ]
    heads = ("seed", "model", "heading", *(f"{angle:+d} deg" for angle in ANGLES_DEG))
    return [
        _fits_sheet(f"Fit of free runs, %: median (5 %, 95 % of {what}", found.of(CASE), (*GIVEN, *METHODS), "methods"),
        _fits_sheet(title, found.of(CASE), (N4SID, *SETTINGS), "settings"),
        Sheet("seeds", "Every fit, %", heads, every, printed=False),
    ]


def _fits_sheet(title: str, trials: Sequence[Mapping[str, Any]], names: Sequence[str], file: str) -> Sheet:
    """Median and range of the fits by method and log, and how often the cross-check is as good as published."""
    heads = ("model!", *(f"{angle:+d} deg>" for angle in ANGLES_DEG), f"{CROSS_DEG} deg, true>", "reached>")
    rows = []
    for name in names:
        fits, true = (np.array([trial[kind][name] for trial in trials]) for kind in ("fits", "true"))
        good = int(np.count_nonzero(fits[:, CROSS] >= PUBLISHED))
        cells = [_spread(column) for column in (*fits.T, true[:, CROSS])]
        rows.append([name, *cells, f"{good} of {len(trials)}"])
    return Sheet(file, title, heads, rows)


def failures(found: Found) -> list[str]:
    """Models without a run: the number of seeds, and the first reason."""
    trials = found.of(CASE)
    reasons = {name: [t["problems"][name] for t in trials if name in t["problems"]] for name in ALL}
    return [f"{name}: no run in {len(of)} of {len(trials)} seeds. {of[0]}" for name, of in reasons.items() if of]


def _spread(values: np.ndarray) -> str:
    low, middle, high = np.quantile(values, [0.05, 0.5, 0.95], method="nearest")
    if not isfinite(middle):
        return "none"
    return f"{middle:.0f}" if abs(middle) >= 200.0 else f"{middle:.1f} ({low:.1f}, {high:.1f})"


STUDY = Study(
    __doc__ or "",
    attempt,
    (CASE,),
    sheets,
    seeds=50,
    one_of="",
    options={"noise": Option(NOISE_DEG, "of the compass, standard deviation, deg", least=0.0)},
    remarks=failures,
    doing="pool logs",
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
