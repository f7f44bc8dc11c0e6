"""The candidate effects of a vehicle, and the evidence for each in the errors of a record."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np
from scipy import stats

from auv_gym.param import list_paths, spec_at, value_at
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.deciding import ALIKE, MANY, ONLY_STARTS, SEEN
from identification.fit.changing import ChangingPlant, change, changed, named_when
from identification.fit.followed import Point
from identification.fit.parameters import STEP, jumps, kinked
from identification.fit.prediction_errors import PredictionErrors

# Two components of one physical quantity are one candidate; a component that turns out small is dropped at the end.
TOGETHER = (
    ("compass deviation", ("effects.compass.deviation_sin", "effects.compass.deviation_cos")),
    ("steady current", ("effects.current.north", "effects.current.east")),
    ("internal-wave heave", ("effects.water.heave_sin", "effects.water.heave_cos")),
)
# A setting of an effect has no meaning while the effect is absent, so it is searched for and then fitted with it: the
# period of a heave, and where an actuator is stuck.
PERIODS = {"effects.water.heave_sin": "effects.water.heave_period"}
_STUCK, _AT, _PLACES = ".stuck", "_at", 5  # endings of the paths; places over the range of the commands
COMMON_DELAY = "effects.clock.delay"
MOST_PERIODS = 64
_ONE_SIDED = 1.645  # a normal estimate falls this many standard errors below its mean in 5 % of cases
_ONE_SIDE_AT_STOPS = frozenset(["gain", "offset"])  # of an actuator: at a stop of the command, only one sign acts
KINKED_STEPS = (1.0, 5.0)  # steps, in probes, for slopes near a corner, instead of `STEP`


@dataclass(frozen=True)
class Candidate:
    """One effect, or the components of one, that the model may be missing; setting: path of its setting, or ""."""

    title: str
    paths: tuple[str, ...]
    setting: str = ""

    @property
    def free(self) -> tuple[str, ...]:
        """The paths that a fit of the candidate frees."""
        return (*self.paths, self.setting) if self.setting else self.paths

    def in_form(self, form: str, title: str) -> Candidate:
        """The candidate as a change of a `ChangingPlant`."""
        return Candidate(title, tuple(change(form, p) for p in self.paths))

    def steps(self, problem: PredictionErrors) -> tuple[float, ...]:
        """The steps, in probes, for its signatures; both signs if commands may reach a stop."""
        if self.jumps:
            return problem.sticking_sizes(self.paths[0]) or (1.0,)
        if self.kinked:
            return KINKED_STEPS
        return (STEP, -STEP) if self.paths[0].rpartition(".")[2] in _ONE_SIDE_AT_STOPS else (STEP,)

    @property
    def kinked(self) -> bool:
        """Whether it acts in one direction from its neutral value, with a corner there."""
        return kinked(self.paths[0])

    @property
    def jumps(self) -> bool:
        """Whether its signature does not scale with its size, so that each size needs its own."""
        return jumps(self.paths[0])

    @property
    def periodic(self) -> bool:
        """Whether its setting is a period."""
        return self.setting in PERIODS.values()

    @property
    def sloped(self) -> bool:
        """Whether its slope at neutral describes it: false for an effect with a period or with jumps."""
        return not self.periodic and not self.jumps


@dataclass(frozen=True)
class Screening:
    """The regression of the errors on a candidate's signature, before any fit.

    estimate: (len(paths),), in probes.  evidence: twice the gain in log-likelihood that it promises.
    seen: share of the signature that neither coefficients nor initial states can imitate.
    detectable: (len(paths),), the size in the parameters' units that this record would show with 95 % probability.
    unseen: why it cannot be seen, or "".  setting: the best one of the `tried`; NaN if it has none.
    beside: changes of the fitted parameters in the regression with it, in their scales; empty if unseen.
    together: evidence for all candidates of its part of the vehicle together, and the number of parameters; both 0 if
    parts are not tested.
    """

    candidate: Candidate
    estimate: np.ndarray
    evidence: float
    seen: float
    detectable: np.ndarray
    unseen: str = ""
    setting: float = np.nan
    tried: int = 1
    beside: np.ndarray = field(default_factory=lambda: np.empty(0))
    together: tuple[float, int] = (0.0, 0)

    @property
    def chance(self) -> float:
        """The probability of so much evidence for a part without a missing effect; 0 if parts are not tested."""
        evidence, parameters = self.together
        return float(stats.chi2.sf(evidence, parameters)) if parameters else 0.0


def part_of(path: str) -> str:
    """The part of the vehicle that an effect belongs to: a part by its name, or the hull, a sensor, the load."""
    return path.split(".")[1]


def candidates_of(plant: Plant, record: Record | None = None) -> list[Candidate]:
    """Every effect that is neutral in the plant, has a probe, and is not measured by the record.

    Effects known exactly are left out.  For several logs, effects in only some of them are included if the plant has
    such.
    """
    free = [
        path
        for path in list_paths(plant)
        if path.startswith("effects.")
        and spec_at(plant, path).probe > 0.0
        and value_at(plant, path) == spec_at(plant, path).neutral
        and plant.deviations.get(path) != 0.0
        and not (record is not None and record.has(plant.family.measured.get(path, "time_s")))
        and not (path == COMMON_DELAY and record is not None and _moved(plant, record) < 2)
    ]
    found = _grouped(plant, free)
    if isinstance(plant, ChangingPlant):
        zero = [changed(p) for p in plant.changes if value_at(plant, p) == 0.0]
        for form, course in plant.courses.items():
            if course.name:
                own = _grouped(plant, [path for f, path in zero if f == form])
                found += [c.in_form(form, named_when(c.title, course.name)) for c in own]
    return found


def _grouped(plant: Plant, free: Sequence[str]) -> list[Candidate]:
    """Some effects as candidates, with the components of one quantity together."""
    found, used = list[Candidate](), set[str]()
    for path in free:
        if path in used:
            continue
        title, paths = next(((t, p) for t, p in TOGETHER if path in p), (spec_at(plant, path).title, (path,)))
        paths = tuple(p for p in paths if p in free)
        used.update(paths)
        if paths[0] not in PERIODS.values():
            found.append(Candidate(title, paths, _setting_of(plant, paths[0])))
    return found


def _setting_of(plant: Plant, path: str) -> str:
    """The path of an effect's setting, "" for an effect without one."""
    at = path + _AT
    return at if path.endswith(_STUCK) and at in list_paths(plant) else PERIODS.get(path, "")


def settings_of(plant: Plant, record: Record, candidate: Candidate) -> np.ndarray:
    """The settings to try: periods, or places over the range of the commands of the actuator that may be stuck."""
    if candidate.periodic:
        return periods_of(record)
    of = f"{part_of(candidate.paths[0])}_"
    commands = next((record[name] for name in plant.inputs if name.startswith(of) and record.has(name)), None)
    if commands is None:
        return np.array([value_at(plant, candidate.setting)])
    return np.linspace(np.nanmin(commands), np.nanmax(commands), _PLACES)


def _moved(plant: Plant, record: Record) -> int:
    """Number of actuators that the commands of a record move: the common delay of only one is its dead time."""
    return sum(record.has(name) and bool(np.ptp(record[name]) > 0.0) for name in plant.family.actuators)


def periods_of(record: Record) -> np.ndarray:
    """Periods, s, that a record can show: from its length down to four samples, half a resolution apart.

    At most the `MOST_PERIODS` longest.  None for several logs or dives: the phase in each is unknown.
    """
    if len(set(record.labels)) > 1 or (np.diff(record.time) < 0.0).any():
        return np.empty(0)
    lowest, highest = 1.0 / np.ptp(record.time), 0.25 / record.sample_interval
    count = max(int((highest - lowest) / (0.5 * lowest)) + 1, 2)
    if count <= MOST_PERIODS:
        return 1.0 / np.linspace(lowest, highest, count)
    return 1.0 / (lowest * (1.0 + 0.5 * np.arange(MOST_PERIODS)))


def screen(
    problem: PredictionErrors, point: Point, fitted: Sequence[str], candidates: Sequence[Candidate], threshold: float
) -> list[Screening]:
    """Regression of the filter's errors on each candidate's signature, most promising first.

    A signature is the change of the predictions when the candidate leaves neutral by one probe.  It is simulated, and
    therefore aligned in time; its part that fitted coefficients can imitate is removed.  One pass gives all signatures.
    For an effect with a corner at neutral, a larger size is tried, too.
    threshold: the evidence that a finding needs, for the detectable sizes.
    """
    return Regression(problem, point, fitted, threshold).screened(candidates)


def screen_pairs(
    problem: PredictionErrors,
    point: Point,
    fitted: Sequence[str],
    candidates: Sequence[Candidate],
    threshold: float,
    most: int,
    instead: Candidate | None,
) -> list[tuple[Screening, tuple[Screening, Screening]]]:
    """Regression of the filter's errors on every two signatures at once: the pair, as one candidate, and its members.

    The `most` promising pairs are returned, best first.  threshold: see `screen`.  Pairs of similar effects are left
    out, and pairs in which a one-directional effect would have the wrong sign; periods and jumps are not tried.
    instead: an effect that a pair must exceed in evidence.
    """
    regression = Regression(problem, point, fitted, threshold)
    least = 0.0 if instead is None else regression.of([instead])[0].evidence
    pairs = regression.pairs([c for c in candidates if c.sloped], most)
    return [pair for pair in pairs if pair[0].evidence > least]


def screen_signatures(
    problem: PredictionErrors, point: Point, fitted: Sequence[str], candidates: Sequence[Candidate], threshold: float
) -> tuple[list[tuple[Screening, np.ndarray]], np.ndarray]:
    """Like `screen`, with each signature beside the fitted parameters, (paths, n), and the remaining errors, (n,).

    Candidates keep their order; one with a corner at neutral appears once for each of its sizes.
    """
    regression = Regression(problem, point, fitted, threshold)
    return [(one, rest) for one, rest, _ in regression._signed(candidates)], regression.left


def deviations_shown(threshold: float) -> float:
    """The number of standard errors at which the evidence for an effect exceeds a threshold with 95 % probability."""
    return float(np.sqrt(threshold)) + _ONE_SIDED


def _best_setting(regression: Regression, candidate: Candidate, point: Point) -> Screening:
    """The screening of a candidate at the setting with the most evidence."""
    problem = regression.problem
    settings = settings_of(problem.plant, problem.record, candidate)
    if not settings.size:
        size = len(candidate.paths)
        unseen = "its phase is not known from one log to the next"
        return Screening(candidate, np.zeros(size), 0.0, 0.0, np.full(size, np.inf), unseen)
    found = []
    for setting in settings:
        vector = point.vector.copy()
        vector[problem.index[candidate.setting]] = setting
        found.append(replace(regression.of([candidate], vector)[0], setting=float(setting)))
    return replace(max(found, key=lambda s: s.evidence), tried=settings.size)


_Signed = tuple[Screening, np.ndarray, np.ndarray]  # see `Regression._signed`


class Regression:
    """The errors of a point, the signatures of its fitted coefficients, and regressions beside these; see `screen`."""

    def __init__(self, problem: PredictionErrors, point: Point, fitted: Sequence[str], threshold: float):
        self.problem, self.point, self.fitted, self.threshold = problem, point, fitted, threshold
        self.nuisance = problem.flat_slopes(point, fitted)
        pulled, rates = problem.pulls(point.vector, fitted)
        # the priors of the coefficients count as data: a row for each
        self.known = np.diag(rates) if len(fitted) else np.zeros((0, 0))
        self.tall = np.hstack([self.nuisance, self.known])
        starts = problem.start_basis(point)
        self.starts = np.vstack([starts, np.zeros((len(fitted), starts.shape[1]))])
        residual = np.r_[point.errors.ravel(), -pulled]
        self.residual = residual
        self.basis, self.triangle = np.linalg.qr(np.hstack([self.starts, self.tall.T]))
        self.left = residual - self.basis @ (self.basis.T @ residual)

    @property
    def regained(self) -> float:
        """The evidence that a step of the fitted parameters and starts promises by itself."""
        return float(self.residual @ self.residual - self.left @ self.left)

    def beside(self, signatures: np.ndarray) -> np.ndarray:
        """The part of signatures, (P, rows * C), that fitted parameters and starts cannot imitate, (P, len(left))."""
        wide = np.hstack([signatures, np.zeros((len(signatures), len(self.fitted)))])
        return wide - (wide @ self.basis) @ self.basis.T

    def evidence_of(self, signatures: np.ndarray) -> float:
        """Evidence for a set of signatures, (P, rows * C), all free at once."""
        rest = self.beside(signatures)
        told = rest @ self.left
        return float(told @ np.linalg.pinv(rest @ rest.T, rcond=1e-10, hermitian=True) @ told)

    def screened(self, candidates: Sequence[Candidate]) -> list[Screening]:
        """The screenings of candidates, see `screen`."""
        result = self.of([c for c in candidates if not c.setting])
        together = {part_of(s.candidate.paths[0]): s.together for s in result}
        for candidate in (c for c in candidates if c.setting):
            own = together.get(part_of(candidate.paths[0]), (0.0, 0))
            result.append(replace(_best_setting(self, candidate, self.point), together=own))
        return sorted(result, key=lambda s: -s.evidence)

    def shown(self, sizes: Mapping[str, float]) -> dict[str, float]:
        """The changes of the measurements by effects of these sizes, in probes, in deviations of the errors.

        The part that coefficients and starts can imitate is left out.  The effects are simulated at these sizes: no
        slope is scaled.
        """
        changes = self.problem.flattened(self.problem.columns_of(self.point, list(sizes.items())))
        rest = np.linalg.norm(self.beside(changes), axis=1)
        return {path: float(size * one) for (path, size), one in zip(sizes.items(), rest, strict=True)}

    def of(self, candidates: Sequence[Candidate], vector: np.ndarray | None = None) -> list[Screening]:
        """A screening for each candidate, in their order; vector: parameters at which the signatures are taken."""
        found: dict[Candidate, Screening] = {}
        signed, many = self._signed(candidates, vector), len(candidates) >= MANY
        together = self._together([rows for rows in signed if not rows[0].candidate.jumps]) if many else {}
        for one, *_ in signed:
            candidate, known = one.candidate, found.get(one.candidate, one)
            better = one if one.evidence > known.evidence or known.unseen else known
            shown = np.minimum(known.detectable, one.detectable) if candidate.jumps else known.detectable
            tried = len(candidate.steps(self.problem)) if candidate.jumps else 1
            found[candidate] = replace(better, detectable=shown, tried=tried)
        return [replace(found[c], together=together.get(part_of(c.paths[0]), (0.0, 0))) for c in candidates]

    def pairs(self, candidates: Sequence[Candidate], most: int) -> list[tuple[Screening, tuple[Screening, Screening]]]:
        """The screenings of pairs, see `screen_pairs`."""
        seen = [rows for rows in self._signed(candidates) if not rows[0].unseen]
        ends = np.cumsum([0, *(len(own) for _, own, _ in seen)])
        rest = np.vstack([own for _, own, _ in seen]) if seen else np.zeros((0, self.left.size))
        gram, told = rest @ rest.T, rest @ self.left
        size = np.sqrt(np.diag(gram))
        cosines = gram / np.outer(size, size)
        best: dict[frozenset[Candidate], tuple[float, int, int, np.ndarray]] = {}
        for i, j in combinations(range(len(seen)), 2):
            a, b = seen[i][0].candidate, seen[j][0].candidate
            rows = np.r_[ends[i] : ends[i + 1], ends[j] : ends[j + 1]]
            # one minus the cosine of two; the difference of two similar effects would be an effect of neither kind
            if a is b or np.linalg.eigvalsh(cosines[np.ix_(rows, rows)])[0] < 1.0 - ALIKE:
                continue
            estimate = np.linalg.solve(gram[np.ix_(rows, rows)], told[rows])
            if any(e < 0.0 for p, e in zip((*a.paths, *b.paths), estimate, strict=True) if kinked(p)):
                continue
            evidence, key = float(estimate @ told[rows]), frozenset((a, b))
            if key not in best or evidence > best[key][0]:
                best[key] = evidence, i, j, estimate
        return [
            (self._both(seen[i], seen[j], estimate, evidence), (seen[i][0], seen[j][0]))
            for evidence, i, j, estimate in sorted(best.values(), key=lambda item: -item[0])[:most]
        ]

    def _both(self, first: _Signed, second: _Signed, estimate: np.ndarray, evidence: float) -> Screening:
        """The screening of two effects as one candidate."""
        a, b = first[0], second[0]
        both = Candidate(f"{a.candidate.title} and {b.candidate.title}", (*a.candidate.paths, *b.candidate.paths))
        beside = self._beside(estimate @ np.vstack([first[2], second[2]]))
        return Screening(
            both, estimate, evidence, min(a.seen, b.seen), np.r_[a.detectable, b.detectable], beside=beside
        )

    def _signed(self, candidates: Sequence[Candidate], vector: np.ndarray | None = None) -> list[_Signed]:
        """A screening for each candidate and step, its signature beside the fitted parameters, and the full one."""
        groups = [(c, step) for c in candidates for step in c.steps(self.problem)]
        if not groups:
            return []
        moves = [(p, step) for c, step in groups for p in c.paths]
        signatures = self.problem.flattened(self.problem.columns_of(self.point, moves, vector))
        signatures = np.hstack([signatures, np.zeros((len(signatures), len(self.fitted)))])
        rest = signatures - (signatures @ self.basis) @ self.basis.T
        ends = np.cumsum([len(c.paths) for c, _ in groups])
        spans = [slice(end - len(c.paths), end) for (c, _), end in zip(groups, ends, strict=True)]
        return [
            (self._one(c, rest[s], signatures[s], step), rest[s], signatures[s])
            for (c, step), s in zip(groups, spans, strict=True)
        ]

    def _together(self, signed: Sequence[_Signed]) -> dict[str, tuple[float, int]]:
        """For each part, the evidence for all of its effects at once, and the number of independent ones."""
        seen: dict[str, list[np.ndarray]] = {}
        for one, rest, whole in signed:
            for path, own, full in zip(one.candidate.paths, rest, whole, strict=True):
                size, rows = np.linalg.norm(own), seen.setdefault(part_of(path), [])
                if size > np.sqrt(SEEN) * max(np.linalg.norm(full), 1e-6):
                    rows.append(own / size)
        found = {}
        for part, rows in seen.items():
            own = np.array(rows).reshape(len(rows), self.left.size)
            values, vectors = np.linalg.eigh(own @ own.T)
            kept = values > SEEN * values.max(initial=0.0)
            shares = vectors[:, kept].T @ (own @ self.left)
            found[part] = (float(np.sum(shares**2 / values[kept])), int(kept.sum()))
        return found

    def _one(self, candidate: Candidate, own: np.ndarray, whole: np.ndarray, step: float) -> Screening:
        size, full = np.einsum("ij,ij->i", own, own), np.einsum("ij,ij->i", whole, whole)
        seen = float(np.min(size / np.maximum(full, 1e-30)))
        unseen = ""
        if not np.all(full > 1e-12):
            seen, unseen = 0.0, "changes nothing that was measured"
        elif np.all(full - ((whole @ self.starts) ** 2).sum(axis=1) < ONLY_STARTS * full):
            seen, unseen = 0.0, "the initial states do the same"
        elif seen < SEEN:
            unseen = self._imitation(whole[0], full[0])
        if unseen:
            nothing = np.zeros(len(candidate.paths))
            return Screening(candidate, nothing, 0.0, seen, nothing + np.inf, unseen)
        gram = own @ own.T
        estimate = np.linalg.lstsq(gram, own @ self.left, rcond=1e-10)[0]
        deviations = np.sqrt(np.diag(np.linalg.pinv(gram, hermitian=True)))
        units = np.array([self.problem.scale(p) for p in candidate.paths])
        sizes = deviations_shown(self.threshold) * deviations * units
        if candidate.jumps:
            estimate, sizes = np.full_like(estimate, step), np.where(sizes <= step * units, step * units, np.inf)
        evidence = float(2.0 * estimate @ (own @ self.left) - estimate @ gram @ estimate)
        if -step in candidate.steps(self.problem) and estimate[0] * step < 0.0:
            estimate, evidence = np.zeros_like(estimate), 0.0  # this slope belongs to the other sign
        return Screening(candidate, estimate, evidence, seen, sizes, beside=self._beside(estimate @ whole))

    def _beside(self, imitated: np.ndarray) -> np.ndarray:
        """The changes of the fitted parameters, in their scales, given a change of the errors by an effect."""
        if not len(self.fitted):
            return np.empty(0)
        rest = self.basis.T @ (self.residual - imitated)
        return np.linalg.lstsq(self.triangle, rest, rcond=1e-12)[0][-len(self.fitted) :]

    def _imitation(self, signature: np.ndarray, power: float) -> str:
        overlap = [abs(signature @ n) / np.sqrt(power * (n @ n) + 1e-30) for n in self.tall]
        if max(overlap, default=0.0) > ALIKE:
            title = spec_at(self.problem.plant, self.fitted[int(np.argmax(overlap))]).title
            return f"{title} has the same effect"
        return "the parameters already fitted have the same effect"
