"""The search of orders that comes before a fit: its ranges as text, its data apart from those that judge, its table."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import sqrt
from typing import Any

from auv_gym.channels import channel
from auv_gym.param import did_you_mean
from auv_gym.record import Record
from identification.identify import split
from identification.linear.orders import TOLERANCE, OrderSearch, check_criterion, search_orders
from identification.page import Table, amount, percent

KEYS = ("n_a", "n_b", "n_c", "delay")
_LONGEST = 50  # of a range; more is a slip of the pen
_PART = re.compile(r"(\d+)(?::(\d+))?")


def search_apart(
    method: str,
    records: Sequence[Record],
    validate: Sequence[Record],
    inputs: Sequence[str] | None,
    outputs: Sequence[str] | None,
    ranges: Mapping[str, Sequence[int]],
    *,
    settings: Mapping[str, Any] | None = None,
    criterion: str = "mdl",
    tolerance: float = TOLERANCE,
    progress: Callable[[float, str], Any] = lambda fraction, text: None,
) -> OrderSearch:
    """The search of orders for `identify(search.estimator(), records, validate)`, without a look at what judges it.

    That is `validate`, or the last third of the data; `held_out` judges orders on the last third of what is then left.
    ranges: see `parse_ranges`.  settings: others of the method.
    """
    check_criterion(criterion)
    given = {name: tuple(names or ()) for name, names in (("inputs", inputs), ("outputs", outputs))}
    for name, names in given.items():
        if not names:
            raise ValueError(f"An order search needs {name}: give channel names, such as stern_plane_rad.")
    if not records:
        raise ValueError("An order search needs at least one record, got none.")
    train = list(records) if validate else split(records)[0]
    apart: list[Record] = []
    if criterion == "held_out":
        train, apart, _ = split(train)
    chosen: dict[str, Any] = {**(settings or {}), **ranges}
    return search_orders(
        method,
        train,
        given["inputs"],
        given["outputs"],
        validate=apart,
        criterion=criterion,
        tolerance=tolerance,
        progress=progress,
        **chosen,
    )


def parse_ranges(texts: Iterable[str]) -> dict[str, tuple[int, ...]]:
    """Orders to try by key from texts such as `n_a=1:6` (both ends are tried) or `delay=1,3`."""
    found: dict[str, tuple[int, ...]] = {}
    for text in texts:
        key, _, value = (part.strip() for part in text.partition("="))
        key = key.replace("-", "_")
        if key not in KEYS:
            raise ValueError(f"An order search has no {key!r}. {did_you_mean(key, KEYS)}It has {', '.join(KEYS)}.")
        if key in found:
            raise ValueError(f"The range of {key} came twice: give it once.")
        values: list[int] = []
        for part in value.split(","):
            match = _PART.fullmatch(part.strip())
            if match is None:
                raise ValueError(
                    f"The range of {key} needs whole numbers, such as {key}=1:4 or {key}=1,3; got {text!r}."
                )
            first, last = int(match[1]), int(match[2] or match[1])
            if last < first:
                raise ValueError(f"The range of {key} is empty, from {first} to {last}: give the smaller number first.")
            if last - first >= _LONGEST:
                raise ValueError(f"The range of {key} has more than {_LONGEST} orders, {part.strip()}: ask for fewer.")
            values += range(first, last + 1)
        found[key] = tuple(values)
    return found


def order_table(search: OrderSearch) -> Table:
    """What each criterion takes, by output; the one that was asked for first, as chosen."""
    noise, judged = hasattr(search.base, "n_c"), "held_out" in search.criteria
    several = {name: any(len(set(getattr(cell, name))) > 1 for cell in search.cells) for name in ("n_b", "delay")}
    rows = []
    for output in search.outputs:
        names = [search.criterion, *(name for name in search.criteria if name != search.criterion)]
        for name in names:
            cell = search.best(output, name)
            told = f"{_WORDS[name]}, chosen" if name == search.criterion else _WORDS[name]
            row = [output, told, str(cell.n_a), _of_inputs(cell.n_b, several["n_b"])]
            row += [str(cell.n_c)] * noise + [_of_inputs(cell.delay, several["delay"]), str(cell.parameters)]
            row += [amount(sqrt(cell.loss), channel(output).unit), *[percent(cell.held_out)] * judged]
            rows.append(row)
    heads = ["output", "criterion", "n_a", "n_b", *["n_c"] * noise, "delay", "parameters", "one-step error, rms"]
    return Table((*heads, *["held-out fit"] * judged), rows, words=2)


_WORDS = {"mdl": "MDL", "aic": "AIC", "bic": "BIC", "held_out": "held-out fit", "parsimony": "parsimony"}


def _of_inputs(numbers: tuple[int, ...], several: bool) -> str:
    return ", ".join(map(str, numbers)) if several else str(numbers[0])
