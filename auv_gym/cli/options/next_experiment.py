"""What `auv-gym diagnose --next-experiment` adds: for each tie the experiments that would tell its effects apart."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from auv_gym.cli.options.console import output, table

if TYPE_CHECKING:
    from identification.diagnosis import Diagnosis
    from identification.planning.next_experiment import Proposal

_FILES = ("next_experiment.toml", "next_experiment_of_tie_{}.toml")


@dataclass(frozen=True, eq=False)
class Planned:
    """The designs for one tie, best first, and the campaign file of the best."""

    titles: tuple[str, ...]
    proposals: tuple[Proposal, ...]
    file: Path


def propose_experiments(diagnosis: Diagnosis, out: Path, progress: Callable[[float, str], None]) -> list[Planned]:
    """What would tell the effects of each tie apart; the best of each tie is written into the folder."""
    from identification.planning.next_experiment import next_experiment, rivals_of, write_experiment

    planned = []
    for number, rivals in enumerate(rivals_of(diagnosis)):
        plant = diagnosis.plants["given"]
        found = next_experiment(plant, rivals, record=diagnosis.record, seed=diagnosis.seed, progress=progress)
        name = _FILES[0] if number == 0 else _FILES[1].format(number + 1)
        file = write_experiment(found[0], plant, rivals, out, name)
        planned.append(Planned(tuple(rival.title for rival in rivals), found, file))
    return planned


def tell(planned: Sequence[Planned]) -> None:
    """Print a table of the designs for each tie, and what to do."""
    from identification.planning.next_experiment import words

    if not planned:
        output.print("No effects are tied, so no experiment is needed to tell them apart.")
    for plan in planned:
        shown = table(f"To tell apart: {', '.join(plan.titles)}", "experiment", "minutes>", "evidence a minute>", "")
        for proposal in plan.proposals:
            minutes = f"{proposal.minutes:.0f}" if proposal.minutes < float("inf") else "never"
            pace = f"{proposal.evidence / proposal.simulated:.3g}" if proposal.simulated > 0.0 else ""
            shown.add_row(proposal.design.title, minutes, pace, proposal.reason)
        output.print(shown)
        output.print(words(plan.proposals), markup=False)
        output.print()
