"""The application that the commands belong to."""

from __future__ import annotations

from typing import Annotated

import typer

from auv_gym import __version__
from auv_gym.cli.options.console import output

app = typer.Typer(
    name="auv-gym",
    help="Simulate, identify and diagnose underwater vehicles.",
    epilog="With a log: `auv-gym look LOG`, then `auv-gym diagnose LOG --vehicle NAME --out FOLDER`. Without one: "
    "`auv-gym simulate slocum --effect effects.rudder.offset=0.05 --duration 3600 --out log.nc` makes one.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        output.print(f"auv-gym {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass
