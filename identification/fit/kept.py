"""A cache of slopes at the latest points of a fit: its gate, its intervals and the next search use the same ones."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from threading import Lock
from weakref import ref

import numpy as np

_MOST_KEPT = 2**24  # numbers, 128 MiB


class KeptSlopes:
    """A cache of columns, by point and key; the points used longest ago are dropped when it is full.

    Points are compared by identity, and the columns of a point are dropped with it.  Fits run as threads: columns that
    two threads need at the same time are computed twice and kept once.
    """

    def __init__(self, most: int = _MOST_KEPT):
        self._most, self._lock = most, Lock()
        self._kept: OrderedDict[int, tuple[ref, dict[Hashable, np.ndarray]]] = OrderedDict()
        self._numbers = 0

    def of(self, point: object, keys: Sequence[Hashable], make: Callable[[list[int]], np.ndarray]) -> np.ndarray:
        """The columns of these keys, (P, ...); make: computes the columns of keys, by index, that are not kept."""
        with self._lock:
            held, known = self._kept.get(id(point), (None, {}))
            known = dict(known) if held is not None and held() is point else {}
        new = [k for k, key in enumerate(keys) if key not in known]
        made = make(new) if new else np.empty(0)
        if len(new) == len(keys):
            found = made
        else:
            found = np.stack([known[key] if key in known else made[new.index(k)] for k, key in enumerate(keys)])
        if new:
            self.keep(point, {keys[k]: np.array(column) for k, column in zip(new, made, strict=True)})
        return found

    def keep(self, point: object, columns: Mapping[Hashable, np.ndarray]) -> None:
        """Keep the columns of a point; the oldest columns of other points are dropped if there is no room."""
        with self._lock:
            held, known = self._kept.pop(id(point), (None, {}))
            if held is None or held() is not point:
                self._numbers -= sum(c.size for c in known.values())
                known = {}
            added = {key: column for key, column in columns.items() if key not in known}
            self._kept[id(point)] = ref(point), known | added
            self._numbers += sum(c.size for c in added.values())
            while self._numbers > self._most and self._kept:
                _, (_, gone) = self._kept.popitem(last=False)
                self._numbers -= sum(c.size for c in gone.values())
