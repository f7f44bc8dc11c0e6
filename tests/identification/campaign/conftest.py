"""A small campaign, run, fitted and compared once for the tests of these parts."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from identification.campaign.file.reading import read_campaign
from identification.campaign.file.settings import Campaign
from identification.campaign.fits import fit_models
from identification.campaign.rollouts import compare_rollouts
from identification.campaign.running.conduct import conduct
from tests.identification.campaign.texts import HOPELESS

STUDY = """
name = "study"
description = "A rudder <straight> or 3 deg off"
seeds = 3
[vehicle]
preset = "slocum"
[experiment]
kind = "env"
id = "GliderHeading"
duration_s = 400.0
compass_noise_rad = 0.005
targets = { heading_rad = [[0.0, 0.2], [200.0, 0.6]] }
start = { heading_rad = 0.0 }
[controller]
kind = "pid"
[[excitation]]
kind = "prbs"
at = "rudder_rad"
amplitude = 0.1
clock_s = 12.0
[grid]
vehicle.effects.rudder.offset = [0.0, 0.05]

[[fit]]
name = "line"
method = "arx"
settings = { n_a = 2, n_b = 2 }
inputs = ["rudder_rad"]
outputs = ["heading_rad"]
runs = { seeds = [0, 1] }
each = ["vehicle.effects.rudder.offset"]

[[fit]]
name = "offset"
method = "grey_box"
settings = { free = ["effects.rudder.offset"], window = 100.0 }
runs = { seeds = [0, 1], "vehicle.effects.rudder.offset" = 0.05 }
"""
STUDY += (
    HOPELESS
    + """runs = { seeds = 0 }

[compare]
open_loop = true
closed_loop = true
runs = { seeds = 2 }
"""
)


@dataclass(frozen=True)
class Study:
    """A campaign and its folder, with what its fits and comparisons gave."""

    campaign: Campaign
    folder: Path
    fits: list
    rollouts: list
    told: list


@pytest.fixture(scope="session")
def study(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "study.toml").write_text(STUDY)
    campaign, out, told = read_campaign(folder / "study.toml"), folder / "out", []
    conduct(campaign, out, jobs=1)
    fits = fit_models(campaign, out, progress=lambda share, name: told.append((share, name)))
    return Study(campaign, out, fits, compare_rollouts(campaign, out), told)
