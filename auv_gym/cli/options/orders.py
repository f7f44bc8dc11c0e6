"""The search of orders before a fit, as options of a command."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated

import typer

from auv_gym.cli.options.numbers import number

Search = Annotated[
    list[str] | None,
    typer.Option(
        "--search",
        metavar="KEY=FROM:TO",
        help="Orders to try (n_a, n_b, n_c or delay), such as n_a=1:6 or delay=1,3; may be repeated. Each output is "
        "searched separately, on the fitted data only; the test data are not used.",
    ),
]
Choose = Annotated[
    str | None,
    typer.Option(
        metavar="CRITERION",
        help="How to choose the orders: mdl (default), aic, bic, held_out (free runs over the last third of the fitted "
        "data) or parsimony (the fewest parameters that lose little compared with mdl).",
    ),
]
Tolerance = Annotated[
    float | None,
    number("With parsimony: the accepted relative increase of the mean square one-step error. Default: 0.5.", 0, 1e9),
]


def check(search: Sequence[str] | None, choose: str | None, tolerance: float | None) -> dict[str, tuple[int, ...]]:
    """The ranges to try; raises where these options do not go together."""
    from identification.linear.polynomials.orders import check_criterion
    from identification.order_search import parse_ranges

    for name, value in (("--choose", choose), ("--tolerance", tolerance)):
        if value is not None and not search:
            raise ValueError(f"{name} chooses among the orders of a search: give --search, such as --search n_a=1:6.")
    if choose is not None:
        check_criterion(choose)
    if tolerance is not None and choose != "parsimony":
        raise ValueError("--tolerance applies to parsimony only: give --choose parsimony, or leave it out.")
    return parse_ranges(search or [])
