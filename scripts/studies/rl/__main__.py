"""Run the study: `python -m scripts.studies.rl --out FOLDER`."""

import sys

from scripts.studies.rl.study import STUDY

if __name__ == "__main__":
    sys.exit(STUDY.main())
