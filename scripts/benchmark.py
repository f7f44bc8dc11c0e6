"""Speed of the compiled code, as ratios within one run: `python -m scripts.benchmark COMMAND`.

Timings are the best of several repeats, since disturbances can only make a run longer.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from types import ModuleType

from rich.console import Console
from rich.table import Table

from scripts.benchmarks import env, gpc, identification, kernel, recursion, rl, rollout

# by command: the module (`add_arguments`, `measure`, and `show` if its numbers are no plain list), and a description
COMMANDS: dict[str, tuple[ModuleType, str]] = {
    "rollout": (rollout, "free runs of a plant, compiled against plain Python"),
    "env": (env, "environments, one and many, beside others, and their start"),
    "recursion": (recursion, "updates of a float's diving model, compiled against plain Python"),
    "identification": (identification, "linear identification, beside other packages"),
    "kernel": (kernel, "kernel regression, beside scikit-learn"),
    "gpc": (gpc, "a step of predictive control and its quadratic program, beside scipy's SLSQP"),
    "rl": (rl, "PPO in our environments, beside Gymnasium's pendulum"),
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one benchmark and print its numbers, as a table or with --json as one JSON object."""
    parser = argparse.ArgumentParser(prog="benchmark", description=(__doc__ or "").splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    for name, (module, words) in COMMANDS.items():
        command = commands.add_parser(name, help=words, description=module.__doc__)
        module.add_arguments(command)
        command.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args(argv)
    module, _ = COMMANDS[arguments.command]
    try:
        numbers = module.measure(arguments)
    except ValueError as error:
        parser.error(str(error))
    if arguments.json:
        print(json.dumps(numbers, indent=2))
    else:
        getattr(module, "show", _show)(numbers)
    return 0


def _show(numbers: dict[str, float]) -> None:
    table = Table("quantity")
    table.add_column("value", justify="right")
    for name, value in numbers.items():
        table.add_row(name.replace("_", " "), f"{value:,.3g}" if value < 1e3 else f"{value:,.0f}")
    Console().print(table)


if __name__ == "__main__":
    raise SystemExit(main())
