"""Model files: a JSON header and plain arrays in one .npz, or a vehicle file; reading one runs no code."""

from __future__ import annotations

import json
import os
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cache
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any, cast

import numpy as np

from auv_gym import __version__
from auv_gym.channels import channel
from auv_gym.model import Model, check_model
from auv_gym.param import did_you_mean
from auv_gym.plant import Plant, load_vehicle, save_vehicle, vehicle_of_text, vehicle_text
from auv_gym.vehicles.body.learned_hull import LearnedHull
from auv_gym.writing import check_ending, replacing

FORMAT, VERSION = "auv-gym model", 1
GROUP = "auv_gym.models"
_HEADER = "header"
_PACKINGS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # those of numpy; others raise errors of different types


def save_model(model: Model, path: str | os.PathLike, attrs: Mapping[str, Any] | None = None) -> None:
    """Write a model that `load_model` reads back bit for bit; written aside, then renamed.

    A plant goes to .toml; one with a learned hull, and all other models, to .npz.

    attrs: further information (method, records, ...), in JSON types.  Raises for a model of unknown form.

    Example:

        >>> from auv_gym import StateSpace, load_model, save_model
        >>> turning = StateSpace([[0.9]], [[0.02]], [[1.0]], ("rudder_rad",), ("r_radps",), dt=1.0)
        >>> save_model(turning, "turning.npz")
        >>> load_model("turning.npz").poles()
        array([0.9])
    """
    check_model("save_model", model)
    wanted = ".toml" if isinstance(model, Plant) and model.learned is None else ".npz"
    check_ending(path, wanted, f"The file of a {type(model).__name__}")
    if isinstance(model, Plant) and wanted == ".toml":
        save_vehicle(model, path)
        return
    kept = LearnedVehicle.of(model) if isinstance(model, Plant) else model
    form = next((name for name, made in forms().items() if type(kept) is made), None)
    if form is None:
        raise ValueError(
            f"A {type(model).__name__} has no form that a model file can hold; forms are {', '.join(forms())}. "
            f"Register the class, a dataclass of arrays, numbers and names, under the entry point group {GROUP!r}."
        )
    arrays, values = {}, {}
    for field in fields(cast("Any", kept)):
        value = getattr(kept, field.name)
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            arrays[field.name] = value
        else:
            values[field.name] = value
    header = {
        "format": FORMAT,
        "version": VERSION,
        "written_by": f"auv-gym {__version__}",
        "form": form,
        "dt_s": model.dt,
        "inputs": {name: channel(name).unit for name in model.inputs},
        "outputs": {name: channel(name).unit for name in model.outputs},
        "fields": values,
        "attrs": dict(attrs or {}),
    }
    try:
        text = json.dumps(header, ensure_ascii=False)
    except TypeError as error:
        raise ValueError(
            f"A {type(model).__name__} or its attrs hold what no JSON header can ({error}): use numbers, text, lists."
        ) from None
    with replacing(path) as new, new.open("wb") as file:
        named: dict[str, Any] = {_HEADER: np.array(text)} | {f"field_{k}": v for k, v in arrays.items()}
        np.savez_compressed(file, **named)


def load_model(path: str | os.PathLike, dt: float | None = None) -> Model:
    """Load a model from a model file (.npz), a vehicle file (.toml) or by a preset's name; raises if it is invalid.

    dt: s, of a vehicle; a model in discrete time has its own.

    Example:

        >>> from auv_gym import load_model
        >>> load_model("slocum").outputs
        ('heading_rad', 'r_radps', 'north_m', 'east_m')
    """
    if Path(path).suffix.lower() != ".npz":
        return load_vehicle(path, dt=dt)
    header, arrays = _read(Path(path))
    known = forms()
    if header["form"] not in known:
        raise ValueError(
            f"{path} holds a model of the form {header['form']!r}; known here are {', '.join(known)}. "
            f"{did_you_mean(str(header['form']), known)}Install the package that it came from."
        )
    made: Any = known[header["form"]]
    values = {**{k: _tuples(v) for k, v in header["fields"].items()}, **arrays}
    needed = {field.name for field in fields(made)}
    if set(values) != needed:
        odd = ", ".join(sorted(needed ^ set(values)))
        raise ValueError(
            f"{path} does not hold the fields of a {made.__name__} ({odd} lacking or unknown): fit and save it again."
        )
    try:
        model = made(**values)
        return model.plant(dt) if isinstance(model, LearnedVehicle) else model
    except (TypeError, ValueError) as error:
        raise ValueError(f"{path} holds no valid {made.__name__}: {error}") from error


@dataclass(frozen=True, eq=False)
class LearnedVehicle:
    """The file content of a plant with a learned hull: the text of its vehicle file, and the fields of the hull."""

    vehicle: str
    support: np.ndarray
    spread: np.ndarray
    sigma: np.ndarray
    coefficients: np.ndarray
    bias: np.ndarray
    reach: float
    trend: np.ndarray

    @classmethod
    def of(cls, plant: Plant) -> LearnedVehicle:
        """The content of a plant that has a learned hull."""
        hull = plant.learned
        return cls(vehicle_text(plant), **{f.name: getattr(hull, f.name) for f in fields(LearnedHull)})

    def plant(self, dt: float | None = None) -> Plant:
        """The plant; dt: its sample time, s, or its own."""
        plant = vehicle_of_text(self.vehicle, "of a learned hull")
        hull = LearnedHull(**{f.name: getattr(self, f.name) for f in fields(LearnedHull)})
        return replace(plant, learned=hull, dt=plant.dt if dt is None else dt)


def model_header(path: str | os.PathLike) -> dict[str, Any]:
    """The header of a model file: form, dt_s, inputs and outputs with units, written_by, attrs, ...

    Example:

        >>> from auv_gym import StateSpace, model_header, save_model
        >>> turning = StateSpace([[0.9]], [[0.02]], [[1.0]], ("rudder_rad",), ("r_radps",), dt=1.0)
        >>> save_model(turning, "turning.npz")
        >>> model_header("turning.npz")["form"]
        'state_space'
    """
    return _read(Path(path))[0]


@cache
def forms() -> dict[str, type]:
    """Classes of models by the name of their form: ours, and those of the entry point group `auv_gym.models`.

    A form whose package cannot be imported is left out.
    """
    from auv_gym.models.linear import Polynomial, StateSpace
    from auv_gym.models.narx import Narx

    found: dict[str, type] = {
        "state_space": StateSpace,
        "polynomial": Polynomial,
        "narx": Narx,
        "learned_vehicle": LearnedVehicle,
    }
    for entry in entry_points(group=GROUP):
        try:
            made = entry.load()
        except Exception:  # any error of a foreign package: only its own form is missing
            continue
        if isinstance(made, type) and is_dataclass(made):
            found.setdefault(entry.name, made)
    return found


def _read(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Header and array fields of a model file."""
    if path.is_dir():
        raise ValueError(f"{path} is a folder: give the path of one model file (.npz) in it.")
    if not path.is_file():
        near = [p.name for p in path.parent.glob("*.npz")] if path.parent.is_dir() else []
        raise ValueError(f"There is no file {path}. {did_you_mean(path.name, near)}Give a model file (.npz or .toml).")
    foreign = f"{path} is no model file: give one that save_model or `auv-gym identify` wrote."
    try:
        if not zipfile.is_zipfile(path):
            raise ValueError(f"{path} is no .npz file, or is cut short: write it again.")
        with np.load(path, allow_pickle=False) as content:
            if any(part.compress_type not in _PACKINGS for part in content.zip.infolist()):
                raise ValueError(f"{path} is packed as save_model packs nothing: write it again.")
            if _HEADER not in content:
                raise ValueError(foreign)
            stored = content[_HEADER]
            if stored.dtype.kind != "U" or stored.ndim != 0:
                raise ValueError(foreign)
            header = json.loads(stored.item())
            if not isinstance(header, dict) or header.get("format") != FORMAT:
                raise ValueError(foreign)
            _check_header(path, header)
            arrays = {name.removeprefix("field_"): content[name] for name in content.files if name != _HEADER}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, KeyError, NotImplementedError) as error:
        raise ValueError(f"{path} is damaged ({error}): write it again.") from error
    except json.JSONDecodeError:
        raise ValueError(f"{path} is damaged: its header is no JSON. Write it again.") from None
    except ValueError as error:
        if "allow_pickle" in str(error):
            raise ValueError(
                f"{path} holds Python objects, which can run code when they are read, and so is not read: models are "
                "plain numbers."
            ) from None
        if str(path) in str(error):
            raise
        raise ValueError(f"{path} is damaged ({error}): write it again.") from error
    return header, arrays


def _check_header(path: Path, header: Mapping[str, Any]) -> None:
    version = header.get("version")
    if not isinstance(version, int) or version > VERSION:
        raise ValueError(
            f"{path} was written by {header.get('written_by', 'another version')}, as version {version!r} of its "
            f"format, and this is auv-gym {__version__}, which reads up to {VERSION}: update auv-gym."
        )
    if not isinstance(header.get("form"), str) or not isinstance(header.get("fields"), dict):
        raise ValueError(f"{path} is damaged: its header names no form and fields. Write it again.")


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value
