"""The variables of a NetCDF file, classic (by scipy) or version 4 (HDF5, by h5py), each read on demand.

xarray is not used: it takes seconds to open the hundreds of variables in gliders' files.
Source: NetCDF User's Guide, appendix "File Format Specifications"; CF conventions 1.11, sections 2.5 and 8.1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np

HDF5_MAGIC: Final = b"\x89HDF\r\n\x1a\n"
CLASSIC_MAGIC: Final = b"CDF"
_NEVER_WRITTEN: Final = 9.9692099683868690e36  # NC_FILL_FLOAT and NC_FILL_DOUBLE
_MOST_VALUES: Final = 200_000_000  # of a variable; a larger size means a damaged header


@dataclass(frozen=True)
class Variable:
    """A variable: its dimensions, without leading ones of length one, and the function that reads it."""

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    kind: str  # as numpy's dtype.kind
    _raw: Callable[[int | None], np.ndarray]
    _attrs: Callable[[], Mapping[str, Any]]

    @cached_property
    def attrs(self) -> dict[str, Any]:
        """The attributes: numbers, text, or lists of them."""
        try:
            return {str(name): _plain(value) for name, value in self._attrs().items()}
        except Exception as error:  # a damaged file may raise almost anything
            raise _damaged(error) from error

    @property
    def is_text(self) -> bool:
        """Whether it holds characters or strings."""
        return self.kind in "SUO"

    def unit(self) -> str:
        """The attribute `units`, '' without one."""
        unit = self.attrs.get("units", "")
        return unit.strip() if isinstance(unit, str) else ""

    def numbers(self, most: int | None = None) -> np.ndarray:
        """The values of the first rows (default all), scaled, with NaN for fill values, as the attributes say."""
        values = self._rows(most)
        fills = [fill for name in ("_FillValue", "missing_value") for fill in np.ravel(self.attrs.get(name, []))]
        fills = [float(fill) for fill in fills if isinstance(fill, int | float | np.number) and np.isfinite(fill)]
        factor, offset = self.attrs.get("scale_factor", 1.0), self.attrs.get("add_offset", 0.0)
        if values.dtype.kind in "iub" and not fills and (factor, offset) == (1.0, 0.0):
            return values
        floats = values.astype(np.float64)
        missing = np.isin(floats, fills)
        if values.dtype.kind == "f":
            missing |= np.isclose(floats, _NEVER_WRITTEN, rtol=1e-6, atol=0.0)
        return np.where(missing, np.nan, floats * factor + offset)

    def number(self) -> float:
        """The single value of a variable without dimensions or of length one; NaN if there are more or none."""
        return float(np.ravel(self.numbers())[0]) if not self.is_text and math.prod(self.shape) == 1 else math.nan

    def text(self) -> str:
        """The text of a variable of characters along one dimension, or of a single string."""
        return "".join(self.lines() if len(self.shape) == 1 else map(_text, np.ravel(self._rows(None)))).strip("\0 ")

    def lines(self, most: int | None = None) -> list[str]:
        """The text of each row."""
        values = self._rows(most)
        if values.ndim == 2:
            return ["".join(map(_text, row)).strip("\0 ") for row in values]
        return [_text(value).strip("\0 ") for value in values]

    def _rows(self, most: int | None) -> np.ndarray:
        if math.prod(self.shape) > _MOST_VALUES:
            raise ValueError(
                f"The variable {self.name!r} has {' x '.join(map(str, self.shape))} values, too many for a log: the "
                "file may be damaged, copy or download it again."
            )
        try:
            values = self._raw(most)
        except Exception as error:
            raise _damaged(error) from error
        return values.astype(values.dtype.newbyteorder("="), copy=True)


@dataclass(frozen=True)
class NetcdfFile:
    """The variables by name, and the attributes of the file."""

    variables: Mapping[str, Variable]
    attrs: Mapping[str, Any]


@contextmanager
def open_netcdf(path: Path) -> Generator[NetcdfFile]:
    """The open file; raises ValueError if it is not NetCDF or damaged, whatever error occurs meanwhile."""
    with path.open("rb") as file:
        magic = file.read(8)
    if magic.startswith(CLASSIC_MAGIC):
        opened, parse = _open_classic, _classic
    elif magic == HDF5_MAGIC:
        opened, parse = _open_hdf5, _hdf5
    else:
        raise ValueError("The file is not NetCDF, which begins with 'CDF' or as an HDF5 file: check its ending.")
    try:
        handle = opened(path)
    except Exception as error:
        raise _damaged(error) from error
    try:
        try:
            found = parse(handle)
        except Exception as error:
            raise _damaged(error) from error
        yield found
    except ValueError:
        raise
    except Exception as error:
        raise _damaged(error) from error
    finally:
        handle.close()


def span_of(time: np.ndarray) -> tuple[float, float] | None:
    """The first and the last known time; None if there is none."""
    known = time[np.isfinite(time)]
    return (float(known[0]), float(known[-1])) if known.size else None


def is_netcdf(head: bytes) -> bool:
    """Whether the first bytes of a file are those of a NetCDF file."""
    return head[:8] == HDF5_MAGIC or (head[:3] == CLASSIC_MAGIC and head[3:4] in (b"\1", b"\2", b"\5"))


def _open_classic(path: Path) -> Any:
    from scipy.io import netcdf_file

    return netcdf_file(path, "r", mmap=True)


def _open_hdf5(path: Path) -> Any:
    import h5py

    return h5py.File(path, "r")


def _classic(handle: Any) -> NetcdfFile:
    variables = {}
    for name, found in handle.variables.items():
        # by name, not by object: a reference to the mapped file would keep it open
        lead = _ones(found.shape)
        variables[name] = Variable(
            name,
            tuple(found.dimensions)[lead:],
            tuple(found.shape)[lead:],
            found.data.dtype.kind,
            lambda most, name=name, lead=lead: _some(handle.variables[name].data, lead, most),
            lambda name=name: handle.variables[name]._attributes,
        )
    return NetcdfFile(variables, {name: _plain(value) for name, value in handle._attributes.items()})


def _hdf5(handle: Any) -> NetcdfFile:
    import h5py

    h5o = import_module("h5py.h5o")
    datasets = {
        name: found
        for name, found in handle.items()
        if isinstance(found, h5py.Dataset) and found.dtype.kind in "fiubSUO"
    }
    # dimensions are referenced by address; asking h5py for their names takes ms each
    names = {h5o.get_info(found.id).addr: name for name, found in datasets.items()}
    variables = {}
    for name, found in datasets.items():
        dims = _hdf5_dims(handle, name, found, names)
        if dims is None:
            continue
        lead = _ones(found.shape)
        variables[name] = Variable(
            name,
            dims[lead:],
            found.shape[lead:],
            found.dtype.kind,
            lambda most, found=found, lead=lead: _some(found, lead, most),
            lambda found=found: found.attrs,
        )
    return NetcdfFile(variables, {str(name): _plain(value) for name, value in handle.attrs.items()})


def _hdf5_dims(handle: Any, name: str, found: Any, names: dict[int, str]) -> tuple[str, ...] | None:
    """The names of a dataset's dimensions; None if it only names a dimension and holds nothing."""
    h5o, h5r = import_module("h5py.h5o"), import_module("h5py.h5r")
    attrs = found.attrs
    if "DIMENSION_LIST" in attrs:
        dims = []
        for length, refs in zip(found.shape, attrs["DIMENSION_LIST"], strict=True):
            scale = h5r.dereference(refs[0], handle.id) if len(refs) else None
            dims.append(names.get(h5o.get_info(scale).addr if scale else -1, f"of length {length}"))
        return tuple(dims)
    if _plain(attrs.get("CLASS", "")) == "DIMENSION_SCALE":
        if str(_plain(attrs.get("NAME", ""))).startswith("This is a netCDF dimension but not a netCDF variable"):
            return None
        return (name, *(f"of length {n}" for n in found.shape[1:]))[: found.ndim]
    return tuple(f"of length {n}" for n in found.shape)


def _ones(shape: tuple[int, ...]) -> int:
    """Number of leading dimensions of length one."""
    lead = 0
    while lead < len(shape) - 1 and shape[lead] == 1:
        lead += 1
    return lead


def _some(found: Any, lead: int, most: int | None) -> np.ndarray:
    if found.ndim == 0:
        return np.asarray(found[()])
    return np.asarray(found[(0,) * lead + (slice(most),)])


def _plain(value: Any) -> Any:
    """An attribute as a number, text, or a list of them."""
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    if isinstance(value, str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        items = np.asarray(value).ravel().tolist()
        items = [item.decode("utf-8", "replace") if isinstance(item, bytes) else item for item in items]
        return items[0] if len(items) == 1 else items
    return value if isinstance(value, int | float) else ""


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _damaged(error: Exception) -> ValueError:
    return ValueError(f"The NetCDF file is damaged or cut short ({error}): copy or download it again.")
