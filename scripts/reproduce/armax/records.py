"""The records of `scripts/campaigns/vertical_plane.toml`, the experiment of Geng and Zhao 2012, section V."""

from __future__ import annotations

from pathlib import Path

from auv_gym.records.record import Record
from identification.campaign.file.reading import read_campaign
from identification.campaign.running.conduct import conduct

FILE = Path(__file__).parents[2] / "campaigns" / "vertical_plane.toml"
LENGTH = "experiment.duration_s"
IDENTIFY, VERIFY = 600.0, 800.0  # s


def records_of(folder: Path, seed: int = 0, jobs: int = 1) -> dict[tuple[int, float], Record]:
    """The campaign's records by seed and length, s; missing runs are performed.

    seed: added to the seeds of the campaign.  Raises ValueError if a run did not go as planned.
    """
    rows = conduct(read_campaign(FILE, seed), folder, jobs=jobs).rows
    failed = [row for row in rows if not row.usable]
    if failed:
        raise ValueError(
            f"Needed all runs of {FILE.name}, got {len(failed)} that did not go as planned, the first {failed[0].id}: "
            f"{failed[0].status}, {failed[0].reason}. Delete its file in {folder} and run again."
        )
    return {(row.seed, row.cell[LENGTH]): Record.load(row.path(folder)) for row in rows}
