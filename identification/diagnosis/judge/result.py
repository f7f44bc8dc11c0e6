"""The result of a diagnosis, in numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from auv_gym.plant import Plant
from auv_gym.plant.currents import DiveCurrent
from auv_gym.records.record import Record
from identification.diagnosis.extras import Failure
from identification.diagnosis.judge.closing import ClosedLoop
from identification.diagnosis.judge.common import Common
from identification.diagnosis.judge.effects import Coefficient, Detectable, Effect
from identification.diagnosis.judge.habitat import Habitat
from identification.diagnosis.log.checking import Asked
from identification.diagnosis.log.kinematics import Kinematics
from identification.diagnosis.log.plausibility import Doubt
from identification.diagnosis.log.several import in_last_log
from identification.diagnosis.search.attribution import Round
from identification.diagnosis.search.candidates import Screening
from identification.diagnosis.search.discovery import Discovery
from identification.diagnosis.search.remainder import Left
from identification.diagnosis.search.workbench import State
from identification.fit.noises import Noise
from identification.fit.shooting import unknown_states
from identification.fit.validation import FreeRuns, Score, Whiteness

Verdict = Literal["none", "coefficients", "named", "tied", "unexplained", "doubted"]
RARE = "most halves of the log do not choose {it}"
VARIES = "parts of the log contradict each other in the size of {it}"
WORSE = "free runs over unseen parts of the log are worse with {it} than without"
NEEDLESS = "the log is explained as well without {it}"
LEANS = "the log gives no certain size for {it} without the effects that are not named"


@dataclass(frozen=True, eq=False, repr=False)
class Stage:
    """A vehicle and its free runs over all windows.

    unseen: free runs in each part of the record, by a vehicle that was fitted and chosen without that part; the errors
    come from these.  every: free runs of the vehicle itself, for pictures.  Both start from states fitted to a window's
    first seconds.  fitted: runs from states fitted to whole windows, for tests of whiteness.  without: for each part,
    the vehicle that was fitted and chosen without it.
    """

    plant: Plant
    unseen: FreeRuns
    every: FreeRuns
    fitted: FreeRuns
    scores: dict[str, Score]
    whiteness: dict[str, Whiteness]
    without: tuple[Plant, ...] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """The result of comparing a record with a vehicle.

    given, refitted, after: the vehicle as given, with its coefficients refitted, and with the effects found.  before:
    the stage that `after` is compared with: `refitted`, or `given` if only coefficients were found.
    alike: effects in `after` that are not named, since they do not explain the record.  tied: groups of paths that the
    record cannot tell apart.  dropped: paths of effects that were found but are not named, each with the reason
    (`RARE`, `VARIES`, `WORSE`, `NEEDLESS`, `LEANS`).  explained: share of the squared error above the measurement noise
    that the effects remove.  windows: slices of the record, by part.
    doubts: problems of the log itself.  discovery, habitat: description of the unexplained error, if there is any.
    averaged: interval over which readings were averaged, s, or 0.  shortest: whether the length of the log forbids a
    shorter one.  noise: measurement and process noise as the filter estimated them.  left: structure in the one-step
    prediction errors that is not noise.  resting: states that no sensor measures.  left_out: channels not compared.
    loops: the closed loop with each vehicle.  common: the common prediction of each tie.  planned: whether an
    experiment that tells tied causes apart is planned.  spread: copies of the vehicle `after`, each moved by one
    standard error in an independent direction of the fit.  currents: those of the dives between two GPS fixes.
    failures: parts that could not be made.  unfinished: steps skipped at the time limit.  seconds: spent on each step.
    """

    verdict: Verdict
    record: Record
    given: Stage
    refitted: Stage
    before: Stage
    after: Stage
    effects: tuple[Effect, ...]
    tied: tuple[tuple[str, ...], ...]
    coefficients: tuple[Coefficient, ...]
    detectable: tuple[Detectable, ...]
    rounds: tuple[Round, ...]
    state: State
    screening: tuple[Screening, ...]
    explained: float
    remains: dict[str, dict[str, Any]]
    windows: tuple[tuple[slice, ...], ...]
    window: float
    settle: float
    seed: int
    alike: tuple[Effect, ...] = ()
    asked: Asked = field(default_factory=Asked)
    dropped: Mapping[str, str] = field(default_factory=dict)
    doubts: tuple[Doubt, ...] = ()
    kinematics: Kinematics | None = None
    discovery: Discovery | None = None
    habitat: Habitat | None = None
    noise: Noise | None = None
    averaged: float = 0.0
    shortest: bool = False
    left: Left = field(default_factory=Left)
    resting: tuple[str, ...] = ()
    left_out: tuple[str, ...] = ()
    loops: tuple[ClosedLoop, ...] = ()
    common: tuple[Common, ...] = ()
    planned: bool = False
    spread: tuple[Plant, ...] = ()
    currents: tuple[DiveCurrent, ...] = ()
    failures: tuple[Failure, ...] = ()
    unfinished: tuple[str, ...] = ()
    source: str = ""
    versions: dict[str, str] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)

    @property
    def plants(self) -> dict[str, Plant]:
        """The vehicle as given, before and after; as in the last log, where logs have effects of their own."""
        stages = {"given": self.given, "before": self.before, "after": self.after}
        return {name: in_last_log(stage.plant, self.record) for name, stage in stages.items()}

    @property
    def stages(self) -> dict[str, Stage]:
        """The stages that differ, by what they are called: as given, before or refitted, after."""
        found = {"as given": self.given}
        if self.refitted is not self.given:
            found["before" if self.changed and self.before is self.refitted else "refitted"] = self.refitted
        if self.changed and self.after is not self.refitted:
            found["after"] = self.after
        return found

    @property
    def sensors(self) -> Kinematics | None:
        """The kinematic checks, without the comparison of depth with a speed that was derived from depth."""
        if self.kinematics is None or "u_mps: depth rate" not in str(self.record.attrs.get("derived", "")):
            return self.kinematics
        derived = "depth against speed through the water"
        equations = tuple(title for title in self.kinematics.equations if title != derived)
        mismatches = tuple(m for m in self.kinematics.mismatches if m.between[0] != derived)
        return replace(self.kinematics, equations=equations, mismatches=mismatches)

    @property
    def changed(self) -> bool:
        """Whether anything was added to the vehicle: effects, or a term found in the data."""
        return bool(self.added) or (self.discovery is not None and self.discovery.holds)

    @property
    def added(self) -> tuple[Effect, ...]:
        """The effects of the vehicle after, named or not."""
        return (*self.effects, *self.alike)

    def noise_of(self, name: str) -> float:
        """The standard deviation of a sensor's noise as estimated by the filter; infinite if it is unknown."""
        return self.noise.measurement.get(name, np.inf) if self.noise is not None else np.inf

    @property
    def unexplained(self) -> bool:
        """Whether something is left that neither the effects nor a refit explains."""
        return self.verdict == "unexplained" or self.discovery is not None

    @property
    def only_noise(self) -> bool:
        """Whether one-step predictions leave nothing but noise."""
        return not (self.left or self.unexplained)

    @property
    def only_pushed(self) -> bool:
        """Whether only noise is left, and random accelerations are part of it."""
        return self.only_noise and self.noise is not None and bool(self.noise.process)

    @property
    def titles(self) -> dict[str, str]:
        """The titles of effects and coefficients, by path."""
        named = {x.path: x.title for e in self.added for x in (*e.members, e)}
        others = {x.path: x.title for x in self.detectable} | {c.path: c.title for c in self.coefficients}
        return others | named

    @property
    def probabilities(self) -> dict[str, float]:
        """The probability of each named effect and of the effects tied with it, by path."""
        members = {m.path: m.probability for e in self.added for m in e.members}
        return members | {e.path: e.probability for e in self.added if e.probability is not None}

    def dropped_for(self, reason: str) -> list[str]:
        """The titles of effects that were found but are not named for this reason."""
        titles = {r.chosen.candidate.paths[0]: r.chosen.candidate.title for r in self.rounds if r.chosen}
        return [titles.get(path, path) for path, why in self.dropped.items() if why == reason]

    @property
    def reach(self) -> str:
        """How far a scored free run goes, in words to follow `free runs`: over 100 s, or between buoyancy actions."""
        stepped = self.given.plant.family.stepped
        return "between buoyancy actions" if stepped else f"over {self.window - self.settle:g} s"

    @property
    def unseen_words(self) -> str:
        """What the scored vehicles were not fitted to: parts of the log, or dives if each dive has an unknown state."""
        segments = np.array([s.start for s in self.record.segments])
        used = {int(np.searchsorted(segments, w.start, side="right")) for part in self.windows for w in part}
        return "dives" if unknown_states(self.given.plant) and len(used) > 1 else "parts of the log"
