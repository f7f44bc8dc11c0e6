"""Run the study: `python -m scripts.studies.process_noise --out FOLDER`."""

import sys

from scripts.studies.process_noise.study import STUDY

if __name__ == "__main__":
    sys.exit(STUDY.main())
