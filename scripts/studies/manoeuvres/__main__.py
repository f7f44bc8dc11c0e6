"""Run the study: `python -m scripts.studies.manoeuvres --out FOLDER`."""

import sys

from scripts.studies.manoeuvres.study import STUDY

if __name__ == "__main__":
    sys.exit(STUDY.main())
