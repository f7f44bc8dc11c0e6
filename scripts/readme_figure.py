"""Draw the picture of the README, and print its numbers: the diagnosis of a real glider log.

python -m scripts.readme_figure --out docs/images
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from auv_gym.plant import load_vehicle
from auv_gym.records.reading import read_record
from auv_gym.writing import replacing
from identification.diagnosis import diagnose
from identification.pages.diagnosis_figures import zoom_figure


def main(argv: Sequence[str] | None = None) -> int:
    """Diagnose the log, print the summary, write ammonite.png."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images"), help="folder for the picture")
    args = parser.parse_args(argv)
    record = read_record("slocum:ammonite")
    result = diagnose(record.select(record["depth_m"] > 10.0), load_vehicle("slocum"), source="slocum:ammonite")
    print(result.summary())
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "ammonite.png"
    with replacing(path) as new:
        zoom_figure(result).savefig(new, format="png", dpi=120)
    print(path)
    return 0


if __name__ == "__main__":
    sys.exit(main())
