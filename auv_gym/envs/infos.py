"""Infos as named numbers of a row that are only unpacked when they are read, which keeps a step cheap."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from struct import Struct
from typing import final

from auv_gym.envs.episodes import Episodes
from auv_gym.envs.kernel.layout import offset
from auv_gym.plant import Plant

_NUMBER = Struct("d")


@final
class Named(Mapping[str, float]):
    """A read-only mapping from names to floats, equal to a dict of the same items.

    The maker sets `index` (name to position) and `numbers` (the bytes of the floats), which are three times as fast to
    get from an array as a copy. A constructor in Python would take twice the time, and a step makes five of these.
    """

    __slots__ = ("index", "numbers")
    index: Mapping[str, int]
    numbers: bytes

    def __getitem__(self, name: str) -> float:
        return _NUMBER.unpack_from(self.numbers, _NUMBER.size * self.index[name])[0]

    def __iter__(self) -> Iterator[str]:
        return iter(self.index)

    def __len__(self) -> int:
        return len(self.index)

    def __repr__(self) -> str:
        return repr(dict(self))


@dataclass(frozen=True, eq=False)
class InfoIndex:
    """The numbers of a row that an info shows: from `first` to `last`, with the positions of single ones and groups."""

    first: int
    last: int
    single: Mapping[str, int]
    groups: Mapping[str, Mapping[str, int]]

    @classmethod
    def of(cls, episodes: Episodes) -> InfoIndex:
        family, kind, record = episodes.plant.family, episodes.kind, episodes.row_type
        first, state_at = offset(record, "features"), int(episodes.settings["state_at"])
        features = {name: k for k, name in enumerate((*family.outputs, *kind.layout.geometry))}
        readings = kind.readings or {name: name for name in family.outputs}
        single = {"time_s": "time", **kind.infos}
        if isinstance(episodes.driver, Plant) and episodes.driver.learned is not None:
            single["support_distance"] = "support_distance"

        def following(at: int, names: tuple[str, ...]) -> dict[str, int]:
            return {name: at - first + k for k, name in enumerate(names)}

        return cls(
            first=first,
            last=state_at + len(episodes.state_names),
            single={name: offset(record, field) - first for name, field in single.items()},
            groups={
                "target": following(offset(record, "target"), episodes.target_channels),
                "reading": {name: features[source] for name, source in readings.items()},
                "command": following(offset(record, "command"), family.inputs),
                "state": following(state_at, episodes.state_names),
                "reward_terms": following(offset(record, "term"), tuple(episodes.task.weights)),
            },
        )
