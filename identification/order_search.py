"""The search of orders before a fit: its ranges as text, and its data, separate from the data that judge the fit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from auv_gym.param import did_you_mean
from auv_gym.records.record import Record, records_of
from identification.identified import split
from identification.linear.polynomials.orders import (
    TOLERANCE,
    Cell,
    OrderSearch,
    check_criterion,
    search_orders,
)

KEYS = ("n_a", "n_b", "n_c", "delay")
_LONGEST = 50  # most values of a range; more is probably a typing error
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
    """The search of orders for `identify(search.estimator(), records, validate)`, without the data that judge the fit.

    Those are `validate`, or the last third of the data; `held_out` judges orders on the last third of the rest.
    ranges: see `parse_ranges`.  settings: other settings of the method.
    """
    check_criterion(criterion)
    given = {name: tuple(names or ()) for name, names in (("inputs", inputs), ("outputs", outputs))}
    for name, names in given.items():
        if not names:
            raise ValueError(f"An order search needs {name}: give channel names, such as stern_plane_rad.")
    records = records_of("An order search", records)
    fixed = sorted({*KEYS, "skip"} & set(settings or {}))
    if fixed:
        raise ValueError(f"An order search sets {', '.join(fixed)} itself: search it over one value instead.")
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
    """Orders to try by key, from texts such as `n_a=1:6` (both ends included) or `delay=1,3`."""
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


def remarks(search: OrderSearch) -> tuple[str, ...]:
    """Remarks on a search: orders that could not be fitted, and chosen orders at the end of the tried range."""
    found = []
    for output in search.outputs:
        cells, best = search.of(output), search.best(output)
        failed = [cell for cell in cells if cell.problem]
        if failed:
            found.append(
                f"{len(failed)} of {len(cells)} orders of {output} could not be fitted, the first: {failed[0].problem}"
            )
        for name in KEYS:
            tried, taken = {_largest(cell, name) for cell in cells}, _largest(best, name)
            if len(tried) > 1 and taken == max(tried):
                found.append(f"{name} of {output} is the largest that was tried, {taken}: try larger ones.")
    return tuple(found)


def _largest(cell: Cell, name: str) -> int:
    value = getattr(cell, name)
    return max(value) if isinstance(value, tuple) else value
