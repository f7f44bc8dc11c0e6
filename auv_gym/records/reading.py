"""Records from files: CSV, NetCDF, MAT and Slocum binaries, with units converted by the suffix of a column's name."""

from __future__ import annotations

import csv
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from auv_gym.channels import SEGMENT_COLUMNS, conversion, is_flag
from auv_gym.param import did_you_mean
from auv_gym.records.mermaid import COLUMNS as MERMAID_COLUMNS, is_mermaid, mermaid_dives
from auv_gym.records.record import Record
from auv_gym.records.slocum import bundled_slocum_log, read_slocum

if TYPE_CHECKING:
    import xarray as xr

_EPOCH_FROM = 1e8  # s; larger times count from 1970 and are moved to start at zero
_MISSING = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})
_DATED = frozenset({"time", "timestamp", "datetime", "date_time", "time_utc", "time_iso"})
_SLOCUM = re.compile(r"\.[demnst](bd|cd)")
_FORMATS = ".csv, .txt, .nc, .cdf, .mat, a Slocum file (.dbd, .mbd, .sbd, .ebd, ...) or slocum:NAME"


@dataclass(frozen=True)
class Table:
    """The columns of a file as they came: numbers, or text for labels and dates; units where the file states them."""

    columns: dict[str, np.ndarray | list[str]]
    units: dict[str, str] = field(default_factory=dict)


def read_record(
    path: str | Path,
    mapping: Mapping[str, str | float] | str | Path | None = None,
    required: Iterable[str] = (),
    *,
    max_gap_s: float | None = None,
    long_runs: Literal["cut", "raise"] = "cut",
) -> Record:
    """The record in a file (chosen by its ending) or in a log that dbdreader ships (`slocum:ammonite`), cut at gaps.

    mapping: their column to our channel or to '' (left out), as a dict or the path of a flat TOML file; '*' stands for
    all columns not named.  A target's suffix is the column's unit: {"Hdg": "heading_deg"} gives heading_rad.  A number
    is the value of a channel that was constant and not logged: {"speed_cmd_kn": 3.0}.  A minus turns the sign:
    {"fin": "-rudder_rad"}.
    required: channels that must be there.  max_gap_s: see Record.split_gaps.  long_runs: see Record.from_arrays.
    Columns segment, dive_id and run divide the file.  Times beyond 1e8 s, and dates, become s since the first; the
    attribute `start_epoch_s` keeps that.  Raises ValueError on anything that cannot be read or does not fit.
    """
    file = find_log(path)
    suffix = file.suffix.lower()
    if _SLOCUM.fullmatch(suffix):
        if mapping is not None:
            raise ValueError(
                "A mapping renames the columns of a table; a Slocum file is read by its sensors: leave it out."
            )
        record = read_slocum(file, max_gap_s=max_gap_s)
    else:
        record = _read_table(file, suffix, *_load_mapping(mapping), max_gap_s, long_runs)
    for channel in required:
        record[channel]
    return record


def read_columns(path: str | Path) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The columns of a CSV file that is no time series, in our units, and a label for each row ('' without any)."""
    path = find_log(path)
    try:
        table = _csv_table(path)
        labels = _joined([table.columns[name] for name in SEGMENT_COLUMNS if name in table.columns])
        numbers: dict[str, np.ndarray] = {}
        for name, column in table.columns.items():
            if isinstance(column, np.ndarray) and not is_flag(name):
                target, convert = conversion(name)
                numbers[target.name] = convert(column)
        return numbers, np.full(len(next(iter(table.columns.values()))), "") if labels is None else labels
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def find_log(name: str | Path) -> Path:
    """The file of a log, or of one that dbdreader ships (`slocum:ammonite`); raises ValueError if none can be read."""
    text = str(name)
    path = bundled_slocum_log(text.removeprefix("slocum:")) if text.startswith("slocum:") else Path(text)
    suffix = path.suffix.lower()
    if path.is_dir():
        raise ValueError(f"{path} is a folder: give the path of one log file in it.")
    if not path.exists():
        near = [p.name for p in path.parent.iterdir()] if path.parent.is_dir() else []
        raise ValueError(f"There is no file {path}. {did_you_mean(path.name, near)}Give {_FORMATS}.")
    if suffix not in (".csv", ".txt", ".nc", ".cdf", ".mat") and not _SLOCUM.fullmatch(suffix):
        raise ValueError(f"{path} ends in {suffix!r}, which is no known format: give {_FORMATS}.")
    try:
        empty = path.stat().st_size == 0
        path.open("rb").close()
    except OSError as error:
        raise ValueError(f"Cannot read {path}: {error.strerror}.") from error
    if empty:
        raise ValueError(f"{path} is empty (0 bytes): copy or download it again.")
    return path


def _read_table(
    path: Path,
    suffix: str,
    mapping: dict[str, str],
    constants: dict[str, float],
    max_gap_s: float | None,
    long_runs: Literal["cut", "raise"],
) -> Record:
    try:
        if suffix in (".nc", ".cdf"):
            dataset = _open_netcdf(path)
            if "segment_labels" in dataset.attrs and "time_s" in dataset.coords and not mapping and not constants:
                return Record(dataset).split_gaps(max_gap_s)
            table = _netcdf_table(dataset, mapping)
        elif suffix == ".mat":
            table = _mat_table(path, mapping)
        else:
            table = _csv_table(path)
        table = _with_constants(_mapped(table, mapping), constants)
        if is_mermaid(table.columns):  # its readings are minutes apart, or hours: none of that is a gap
            return _mermaid(table, path.name)
        return _assembled(table, path.name, long_runs).split_gaps(max_gap_s)
    except ValueError as error:
        raise error if str(path) in str(error) else ValueError(f"{path}: {error}") from error


def _load_mapping(mapping: Mapping[str, str | float] | str | Path | None) -> tuple[dict[str, str], dict[str, float]]:
    """Names by column, and constants by channel."""
    if isinstance(mapping, (str, Path)):
        try:
            mapping = tomllib.loads(Path(mapping).read_text(encoding="utf-8"))
        except OSError as error:
            raise ValueError(f"Cannot read the mapping {mapping}: {error.strerror}.") from error
        except ValueError as error:
            raise ValueError(
                f'The mapping {mapping} is not TOML ({error}): write lines such as "Hdg" = "heading_deg".'
            ) from error
    mapping = dict(mapping or {})
    for theirs, ours in mapping.items():
        if isinstance(ours, bool) or not isinstance(ours, str | int | float):
            raise ValueError(
                f'A mapping has one text per column, got {ours!r} for {theirs!r}: write "{theirs}" = "depth_m", or '
                "a number for a channel of ours that was constant."
            )
    if mapping.get("*"):
        raise ValueError("In a mapping '*' can only be '' (leave out all columns not named).")
    constants = {name: float(value) for name, value in mapping.items() if not isinstance(value, str)}
    return {theirs: ours for theirs, ours in mapping.items() if isinstance(ours, str)}, constants


def _mapped(table: Table, mapping: Mapping[str, str]) -> Table:
    """The table under our names, without the columns that the mapping leaves out."""
    for theirs, ours in mapping.items():
        if ours and theirs not in table.columns:
            raise ValueError(
                f"The mapping names the column {theirs!r}, which the file lacks. {did_you_mean(theirs, table.columns)}"
                f"It has {_listed(table.columns)}."
            )
    columns: dict[str, np.ndarray | list[str]] = {}
    units: dict[str, str] = {}
    for theirs, values in table.columns.items():
        ours = mapping.get(theirs, mapping.get("*", theirs))
        if ours.startswith("-"):
            ours, values = ours[1:], -_numbers(theirs, values)
        if not ours:
            continue
        if ours in columns:
            raise ValueError(f"Two columns come in as {ours!r}: map one of them to another channel, or to ''.")
        columns[ours] = values
        if theirs in table.units and theirs == ours:
            units[ours] = table.units[theirs]
    return Table(columns, units)


def _with_constants(table: Table, constants: Mapping[str, float]) -> Table:
    """The table with channels that were constant and not logged."""
    rows = len(next(iter(table.columns.values()), ()))
    for name in constants:
        if name in table.columns:
            raise ValueError(f"The mapping makes {name!r} constant, but the file has it: leave it out of the mapping.")
    return Table({**table.columns, **{name: np.full(rows, value) for name, value in constants.items()}}, table.units)


def _assembled(table: Table, source: str, long_runs: Literal["cut", "raise"]) -> Record:
    """The record of a table whose columns have our names."""
    time_name = _time_column(table)
    time = _seconds(time_name, table)
    attrs: dict[str, Any] = {"source": source}
    finite = time[np.isfinite(time)]
    if finite.size and finite.min() > _EPOCH_FROM:
        attrs["start_epoch_s"] = float(finite.min())
        time = time - finite.min()
    labels = [table.columns[name] for name in SEGMENT_COLUMNS if name in table.columns]
    values: dict[str, np.ndarray] = {}
    for name, column in table.columns.items():
        if name in (time_name, *SEGMENT_COLUMNS) or (is_flag(name) and isinstance(column, list)):
            continue
        target, convert = conversion(name, table.units.get(name))
        if target.name in values:
            raise ValueError(
                f"Column {name!r} comes in as {target.name!r}, which another does too: map one of them to ''."
            )
        values[target.name] = convert(_numbers(name, column))
    if not values:
        raise ValueError(f"The file has no signal besides its time; it has {_listed(table.columns)}.")
    return Record.from_arrays(time, values, _joined(labels), attrs, long_runs=long_runs)


def _mermaid(table: Table, source: str) -> Record:
    time_name = _time_column(table)
    labels = _joined([table.columns[name] for name in SEGMENT_COLUMNS if name in table.columns])
    time = _seconds(time_name, table)
    columns = {name: _numbers(name, table.columns[name]) for name in MERMAID_COLUMNS}
    return mermaid_dives(time, columns, np.zeros(time.size) if labels is None else labels, source)


def _time_column(table: Table) -> str:
    """The name of the column that holds time: numbers in a unit of time, or dates under a common name."""
    for name, column in table.columns.items():
        dated = name.lower() in _DATED and (isinstance(column, list) or name in table.units)
        if dated or name in ("time_s", "time_ms", "time_min", "time_h"):
            return name
    raise ValueError(
        "There is no column time_s (s; also time_ms, time_min, time_h, or dates in a column time); the columns are "
        f'{_listed(table.columns)}. Rename the one that holds time, or map it, as in "Time" = "time_s".'
    )


def _seconds(name: str, table: Table) -> np.ndarray:
    """Time in s; dates count from 1970, and are UTC where they do not say."""
    column = table.columns[name]
    if isinstance(column, np.ndarray):
        return conversion(name, table.units.get(name)).convert(column)
    seconds = np.empty(len(column))
    for row, cell in enumerate(column):
        try:
            moment = datetime.fromisoformat(cell.strip())
        except ValueError as error:
            raise _bad_cell(name, row, cell, "numbers or dates such as 2024-05-31T12:00:00") from error
        seconds[row] = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    return seconds


def _column(cells: Iterable[str]) -> np.ndarray | list[str]:
    """The numbers in some cells, NaN where a cell is empty; the cells themselves if one is neither."""
    cells = list(cells)
    try:
        return np.array(list(map(float, cells)))
    except ValueError:
        pass
    try:
        return np.array([float("nan" if cell.strip().lower() in _MISSING else cell) for cell in cells])
    except ValueError:
        return cells


def _numbers(name: str, column: np.ndarray | list[str]) -> np.ndarray:
    if isinstance(column, np.ndarray):
        return column.astype(np.float64)
    row = next(row for row, cell in enumerate(column) if isinstance(_column([cell]), list))
    raise _bad_cell(name, row, column[row], "numbers")


def _bad_cell(name: str, row: int, cell: str, wanted: str) -> ValueError:
    hint = " (a decimal comma is not understood)" if re.fullmatch(r"\s*-?\d+,\d+\s*", cell) else ""
    return ValueError(
        f"Column {name!r} needs {wanted}, got {cell!r} at row {row + 1} below the header{hint}: correct the cell, "
        "leave it empty, or map the column to '' to leave it out."
    )


def _joined(columns: list[np.ndarray | list[str]]) -> np.ndarray | None:
    """One label per sample out of the columns that divide a file; of several, a change in any begins a segment."""
    if not columns:
        return None
    if len(columns) == 1:
        return np.asarray(columns[0])
    text = [[_as_label(cell) for cell in column] for column in columns]
    return np.array(["/".join(labels) for labels in zip(*text, strict=True)])


def _as_label(cell: Any) -> str:
    return cell if isinstance(cell, str) else f"{cell:g}"


def _csv_table(path: Path) -> Table:
    """The table in a text file with a header, its columns divided by comma, semicolon or tab."""
    content = path.read_bytes()
    if b"\0" in content[:65536]:
        raise ValueError("The file is binary, not text: check its ending, or export it as CSV.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    lines = [line for line in text.splitlines() if line.strip() and not line.startswith("#")]
    if len(lines) < 3:
        raise ValueError(
            f"A header and at least 2 rows are needed, got {len(lines)} lines in all: export the log again."
        )
    delimiter = max(",;\t", key=lines[0].count)
    header = [name.strip() for name in next(csv.reader(lines[:1], delimiter=delimiter, skipinitialspace=True))]
    if all(isinstance(_column([name]), np.ndarray) for name in header):
        raise ValueError(
            f"The first line holds numbers ({lines[0][:60]!r}): put a header above it that names the columns, such as "
            "time_s,heading_deg,rudder_deg."
        )
    repeated = {name for name in header if header.count(name) > 1}
    if repeated or "" in header:
        what = f"names {_listed(sorted(repeated))} twice" if repeated - {""} else "leaves a column without a name"
        raise ValueError(f"The header {what}: give each column a name of its own.")
    try:
        return Table(dict(zip(header, _numeric_columns(lines[1:], delimiter), strict=True)))
    except ValueError:  # labels, dates, quotes, or something wrong: cell by cell
        rows = list(csv.reader(lines[1:], delimiter=delimiter, skipinitialspace=True))
    for number, row in enumerate(rows):
        if len(row) != len(header):
            last = " The file seems cut short: delete that line." if number == len(rows) - 1 else " Correct the line."
            raise ValueError(
                f"Row {number + 1} below the header has {len(row)} cells, the header has {len(header)}.{last}"
            )
    return Table(dict(zip(header, map(_column, zip(*rows, strict=True)), strict=True)))


def _numeric_columns(lines: list[str], delimiter: str) -> np.ndarray:
    """The columns of lines of numbers and empty cells, shape (columns, rows), fast; raises on anything else."""
    text = "\n".join(["", *lines, ""])
    empty = delimiter * 2
    if empty in text or f"\n{delimiter}" in text or f"{delimiter}\n" in text:
        for _ in range(2):  # of three delimiters in a row, the first pass sees the first two
            text = text.replace(empty, f"{delimiter}nan{delimiter}")
        text = text.replace(f"\n{delimiter}", f"\nnan{delimiter}").replace(f"{delimiter}\n", f"{delimiter}nan\n")
        lines = text.strip("\n").split("\n")
    return np.loadtxt(lines, delimiter=delimiter, comments=None, ndmin=2).T


def _open_netcdf(path: Path) -> xr.Dataset:
    magic = path.read_bytes()[:8]
    engine: Literal["h5netcdf", "scipy"]
    if magic.startswith(b"CDF"):
        engine = "scipy"
    elif magic == b"\x89HDF\r\n\x1a\n":
        engine = "h5netcdf"
    else:
        raise ValueError("The file is not NetCDF, which begins with 'CDF' or as an HDF5 file: check its ending.")
    import xarray as xr  # not above: see Record.from_arrays

    try:
        return xr.load_dataset(path, engine=engine, decode_times=False)
    except Exception as error:  # what a damaged file raises depends on where it is damaged
        raise ValueError(f"The NetCDF file is damaged or cut short ({error}): copy or download it again.") from error


def _netcdf_table(dataset: xr.Dataset, mapping: Mapping[str, str]) -> Table:
    """The variables along the dimension of time; those of other dimensions are no signals and are left out."""
    variables = {str(name): variable for name, variable in dataset.variables.items() if variable.ndim == 1}
    times = [name for name in variables if mapping.get(name, name) == "time_s"]
    times += [name for name in variables if name.lower() in _DATED or name in ("time_ms", "time_min", "time_h")]
    if not times:
        raise ValueError(
            "There is no variable time_s or time along one dimension; the variables are "
            f"{_listed(map(str, dataset.variables))}. "
            'Map the one that holds time, as in "JULD" = "time_s".'
        )
    columns: dict[str, np.ndarray | list[str]] = {}
    units: dict[str, str] = {}
    for name, variable in variables.items():
        if variable.dims != variables[times[0]].dims:
            continue
        unit, values = str(variable.attrs.get("units", "")).strip(), variable.values
        if " since " in unit:
            values, unit = _since_1970(name, dataset[name]), "s"
        columns[name] = values if values.dtype.kind in "fiub" else _column(map(_text, values))
        if unit not in ("", "1", "nodim"):
            units[name] = unit
    return Table(columns, units)


def _since_1970(name: str, variable: xr.DataArray) -> np.ndarray:
    import xarray as xr

    try:
        decoded = xr.decode_cf(variable.to_dataset(name="moment")[["moment"]])["moment"].values
        return (decoded.astype("datetime64[ns]") - np.datetime64(0, "ns")) / np.timedelta64(1, "s")
    except (ValueError, OverflowError) as error:
        raise ValueError(f"The times in {name!r} cannot be read ({error}): give seconds, as time_s.") from error


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _mat_table(path: Path, mapping: Mapping[str, str]) -> Table:
    """The equally long vectors in a MAT file: its variables, or the fields of the one structure that has a time."""
    with path.open("rb") as file:
        head = file.read(520)
    if head.startswith(b"MATLAB 7.3") or head[:8] == b"\x89HDF\r\n\x1a\n":
        raise ValueError("MAT files of version 7.3 are not read: save with `save(name, '-v7')`, or as NetCDF.")
    from scipy.io import loadmat

    try:
        content = loadmat(path, simplify_cells=True)
    except Exception as error:  # what a damaged file raises depends on where it is damaged
        raise ValueError(f"The MAT file is damaged or cut short ({error}): save it again with -v7.") from error
    variables = {name: value for name, value in content.items() if not name.startswith("__")}
    tables = [variables, *(value for value in variables.values() if isinstance(value, dict))]
    vectors = [{name: _vector(v) for name, v in table.items() if _is_vector(v)} for table in tables]
    timed = [table for table in vectors if any(_is_time(mapping.get(name, name)) for name in table)]
    if len(timed) != 1:
        found = [f"{name} ({', '.join(v)})" if isinstance(v, dict) else name for name, v in variables.items()]
        raise ValueError(
            f"One set of vectors with a time_s is needed, got {len(timed)}; there are {', '.join(found) or 'none'}. "
            'Map the vector that holds time, as in "t" = "time_s", or save one structure with the fields as signals.'
        )
    lengths = {name: len(column) for name, column in timed[0].items() if mapping.get(name, mapping.get("*", name))}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"All vectors need one length, got {lengths}: map those that are no signals to ''.")
    return Table(timed[0])


def _is_time(name: str) -> bool:
    return name in ("time_s", "time_ms", "time_min", "time_h") or name.lower() in _DATED


def _is_vector(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 1 and value.size > 1 and value.dtype.kind in "fiubUO"


def _vector(value: np.ndarray) -> np.ndarray | list[str]:
    return value if value.dtype.kind in "fiub" else _column(map(str, value))


def _listed(names: Iterable[str]) -> str:
    return ", ".join(map(repr, names)) or "none"
