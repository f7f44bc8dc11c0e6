"""The whole diagnosis of one record, in four steps: check the log, fit what is known, search, judge."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import TypeVar

from auv_gym.model import Diverged
from auv_gym.plant import Plant, check_vehicle
from auv_gym.plant.record_check import described
from auv_gym.records.record import Record, check_record
from identification.deciding import DOUBT, MOST_EFFECTS
from identification.diagnosis.extras import Extras
from identification.diagnosis.judge.judging import judge
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.log.checking import Asked, CheckedLog, check_log
from identification.diagnosis.log.parts import logs_in
from identification.diagnosis.log.several import with_own_effects
from identification.diagnosis.search.known import fit_known
from identification.diagnosis.search.searching import Searched, may_differ, search_effects
from identification.diagnosis.search.trials import Progress

T = TypeVar("T")


def diagnose(
    record: Record,
    plant: Plant,
    *,
    window: float | None = None,
    settle: float | None = None,
    seed: int = 0,
    most: int = MOST_EFFECTS,
    doubt: float = DOUBT,
    trust: bool = False,
    source: str = "",
    progress: Progress = lambda fraction, text: None,
) -> Diagnosis:
    """The effect that a plant is missing to explain a record, with the error before and after on unseen parts.

    window: s, length of the free runs (see `free_run_windows`).  settle: s at a window's start to which its initial
    states are fitted.  Both default to the vehicle's values.  Windows are shortened for an unstable vehicle, and
    settling times for short windows.
    Several logs (segments of different labels) form one record.  If no effect common to all logs explains it, effects
    of only some logs are also tried.
    doubt: relative standard deviation of the vehicle's coefficients, for those that state none; 0 keeps them all fixed.
    seed: for resampling.  trust: whether to diagnose logs that look mislabelled, too.
    Raises ValueError if the record is too short, lacks a channel, or does not excite the vehicle.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle, replace_at
        >>> from identification import closed_loop, diagnose
        >>> glider = load_vehicle("slocum")
        >>> bent = replace_at(glider, "effects.rudder.offset", 0.03)
        >>> found = diagnose(closed_loop(bent, rng=np.random.default_rng(0)), glider, most=1)
        >>> found.verdict, [effect.path for effect in found.effects]
        ('named', ['effects.rudder.offset'])
    """
    check_vehicle("diagnose", plant)
    check_record("diagnose", record)
    asked, seconds = Asked(window, settle, seed, most, doubt, trust), dict[str, float]()

    def timed(step: str, run: Callable[[], T]) -> T:
        begin = perf_counter()
        try:
            return run()
        finally:
            seconds[step] = seconds.get(step, 0.0) + perf_counter() - begin

    def sought(log: CheckedLog, progress: Progress = progress) -> Searched:
        known = timed("fitting what is known", lambda: fit_known(log, progress))
        return timed("searching effects", lambda: search_effects(log, known, progress))

    def judged(log: CheckedLog, searched: Searched, progress: Progress = progress) -> tuple[Diagnosis, CheckedLog]:
        """The diagnosis, with windows shortened until free runs stay finite, and the log with these windows."""
        try:
            return timed("judging", lambda: judge(log, searched, source, progress)), log
        except Diverged:
            shorter = log.in_shorter_windows()
            if shorter is None:
                raise
        return judged(shorter, searched, progress)

    def once_more(fraction: float, text: str) -> None:
        progress(0.9 + 0.1 * fraction, f"effects of only some logs: {text}")

    progress(0.0, "looking for slips in the log")
    log = timed("checking the log", lambda: check_log(record, plant, asked))
    if log.slipped and not log.firm:
        trusting = diagnose(record, plant, **vars(replace(asked, trust=True)), source=source, progress=progress)
        if not trusting.unexplained:  # effects explain the log down to the noise, mislabelled or not
            return replace(trusting, asked=asked)
    brief = log.in_brief()
    searched = sought(brief)
    if brief is not log and searched.state is searched.nominal:  # weak effects need the whole log
        searched, brief = sought(log), log
    found, brief = judged(brief, searched)

    def of_some_logs() -> tuple[Diagnosis, CheckedLog]:
        """The diagnosis with effects of only some logs if these explain them; otherwise the one without."""
        own = with_own_effects(log, may_differ(searched))
        if own is None:
            return found, brief
        own = own.in_brief()
        again = sought(own, once_more)
        if again.state is again.nominal:
            return found, brief
        apart, own = judged(own, again, once_more)
        return (apart, own) if apart.verdict in ("named", "tied") else (found, brief)

    if found.verdict == "unexplained" and len(logs_in(log.record)) > 1:
        extras = Extras()
        found, brief = extras.attempt("The search for effects of only some logs", of_some_logs, (found, brief))
        found = replace(found, failures=(*found.failures, *extras.failures))
    # restore the channels that were not compared, and keep the notes on which rows were used
    return replace(found, record=described(plant, record).with_notes(brief.record.notes), seconds=seconds)
