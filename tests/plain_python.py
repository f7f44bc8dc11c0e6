"""Programs in processes of their own, compiled or as plain Python."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def run_plain(*arguments: object, jit: str = "0") -> str:
    """What `python ARGUMENTS` prints with this AUV_GYM_JIT, as plain Python by default; it must succeed."""
    environment = {**os.environ, "AUV_GYM_JIT": jit, "PYTHONPATH": str(ROOT)}
    run = [sys.executable, *map(str, arguments)]
    done = subprocess.run(run, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout
