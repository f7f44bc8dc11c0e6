"""Run it: `python -m scripts.reproduce.ls_svm --out FOLDER`."""

import sys

from scripts.reproduce.ls_svm.study import STUDY

if __name__ == "__main__":
    sys.exit(STUDY.main())
