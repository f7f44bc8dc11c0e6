"""The command `auv-gym`; each command is a module here.

What a command needs is imported when it runs, so that the help is there at once. Set `AUV_GYM_DEBUG=1` for tracebacks.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from auv_gym.cli import (  # noqa: F401  # each puts its command into `app`
    campaign,
    compare,
    compare_missions,
    diagnose,
    drawing,
    evaluate,
    export,
    identify,
    listing,
    look,
    monitor,
    onset,
    simulate,
    train,
    tune,
)
from auv_gym.cli.application import app
from auv_gym.cli.options.console import errors
from auv_gym.cli.options.heaps import with_few_heaps
from auv_gym.writing import no_empty_folders


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code: 1 for an error in the data or settings, 2 for one in the usage."""
    with_few_heaps()
    if arguments is None and sys.argv[1:2] == ["look"]:  # a process of its own, which simulates nothing
        os.environ.setdefault("AUV_GYM_JIT", "0")  # so numba is not imported,
        sys.modules.setdefault("dask", None)  # ty: ignore[no-matching-overload]  # nor dask, by xarray: a second and a half
    try:
        with no_empty_folders():
            app(args=None if arguments is None else list(arguments), prog_name="auv-gym")
    except SystemExit as ended:
        exit_ = ended.__context__  # typer's, from what ended the command
        if exit_ is not None and isinstance(exit_.__cause__, KeyboardInterrupt):
            errors.print("Stopped.")
        return ended.code if isinstance(ended.code, int) else int(ended.code is not None)
    except Exception as error:
        if os.environ.get("AUV_GYM_DEBUG", "0") not in ("", "0") or not _is_ours(error):
            raise
        errors.print("[bold red]Error:[/] ", end="")
        errors.print(str(error), markup=False, soft_wrap=True)
        return 1
    return 0


def _is_ours(error: Exception) -> bool:
    """Whether the message alone says what is wrong and what to do."""
    return isinstance(error, ValueError | ImportError | OSError) or type(error).__name__ == "Diverged"
