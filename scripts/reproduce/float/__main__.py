"""Run it: `python -m scripts.reproduce.float --out FOLDER`."""

import sys

from scripts.reproduce.float.study import STUDY

if __name__ == "__main__":
    sys.exit(STUDY.main())
