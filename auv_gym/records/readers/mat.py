"""MAT files up to version 7: vectors of equal length in each structure, or among the variables, that has a time.

scipy reads them; it only builds arrays and dicts and runs nothing.  Source: MATLAB MAT-File Format, MathWorks.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from auv_gym.records.log import Column, Format, Group, Log, Scope
from auv_gym.records.mapping import DATED, TIMES
from auv_gym.records.readers.netcdf_variables import HDF5_MAGIC


def _recognises(path: Path, head: bytes) -> bool:
    if head.startswith(b"MATLAB 5.0") or _is_hdf5(head):
        return head.startswith(b"MATLAB") or path.suffix.lower() == ".mat"
    if path.suffix.lower() != ".mat" or len(head) < 20:
        return False
    kind, rows, columns, imaginary, name = struct.unpack("<5i" if head[0] < 100 and head[3] == 0 else ">5i", head[:20])
    return kind // 1000 in (0, 1) and kind % 1000 < 100 and min(rows, columns) >= 0 and 0 <= imaginary < 2 and name > 0


def _is_hdf5(head: bytes) -> bool:
    return head.startswith(b"MATLAB 7.3") or head[:8] == HDF5_MAGIC


def _read(path: Path, scope: Scope) -> Log:
    """The log in a MAT file; every group has its time among its columns.

    If no set of vectors has a time by name, all sets are returned, so that a mapping can name it.
    """
    with path.open("rb") as file:
        if _is_hdf5(file.read(520)):
            raise ValueError("MAT files of version 7.3 are not read: save with `save(name, '-v7')`, or as NetCDF.")
    from scipy.io import loadmat

    scope.progress(0.0, f"reading {path.name}")
    try:
        content = loadmat(path, simplify_cells=True)
    except Exception as error:  # a damaged file may raise almost anything
        raise ValueError(f"The MAT file is damaged or cut short ({error}): save it again with -v7.") from error
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    sets = {"": variables} | {name: value for name, value in variables.items() if isinstance(value, dict)}
    vectors = {name: {key: v for key, v in found.items() if _is_vector(v)} for name, found in sets.items()}
    vectors = {name: found for name, found in vectors.items() if found}
    timed = {name: found for name, found in vectors.items() if any(map(_is_time, found))}
    if not vectors:
        raise ValueError(
            f"A set of vectors with a time is needed; there are {', '.join(variables) or 'none'}: save the signals as "
            "vectors of one length, with their time, as in time_s."
        )
    groups: list[Group] = []
    notes: list[str] = []
    for name, found in (timed or vectors).items():
        if scope.wants(name):
            columns = _equally_long(name, found, notes)
            if len(timed) > 1:  # one structure for each kind of message
                columns = {f"{name}.{key}": column for key, column in columns.items()}
            rows = len(next(iter(columns.values())))
            groups.append(Group(name, {key: column[: scope.most] for key, column in columns.items()}, rows=rows))
    return Log("MAT", path.name, tuple(groups), notes=tuple(notes))


def _equally_long(name: str, vectors: Mapping[str, np.ndarray], notes: list[str]) -> dict[str, Column]:
    """The vectors as long as the one that holds time, or as most are; raises if none is as long as time."""
    lengths = {key: len(vector) for key, vector in vectors.items()}
    time = next(filter(_is_time, vectors), None)
    counted = list(lengths.values())
    length = max(counted, key=lambda n: (counted.count(n), n)) if time is None else lengths[time]
    chosen = {key: _column(vector) for key, vector in vectors.items() if len(vector) == length}
    if len(set(lengths.values())) > 1:
        if len(chosen) < 2:
            raise ValueError(f"All vectors need one length, got {lengths}: save those that are signals alike.")
        left = ", ".join(f"{key} ({n})" for key, n in lengths.items() if n != length)
        where = f" of {name}" if name else ""
        notes.append(f"Left out, as they are not as long as the others{where} ({length}): {left}.")
    return chosen


def _is_time(name: str) -> bool:
    return name in TIMES or name.lower() in DATED


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 1 and value.size > 1 and value.dtype.kind in "fiubUO"


def _column(vector: np.ndarray) -> Column:
    """Numbers, or text; cells that each hold a number become numbers."""
    if vector.dtype.kind in "fiub":
        return vector
    try:
        return np.array([float(cell) if str(cell).strip() else np.nan for cell in vector])
    except (TypeError, ValueError):
        return list(map(str, vector))


FORMAT: Final = Format("MAT", (".mat",), _recognises, _read)
