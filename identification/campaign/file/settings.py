"""The settings of a campaign file; docs/campaigns.md documents every key."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, final

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

Pair = tuple[float, float]
Steps = Annotated[tuple[Pair, ...], Field(min_length=1)]


class Table(BaseModel):
    """A table of a campaign file: no value is converted, and no unknown key is accepted."""

    model_config = ConfigDict(strict=True, extra="forbid", frozen=True, allow_inf_nan=False)


class OpenTable(Table):
    """A table that also holds the settings of the object that it names; these are checked when the object is made."""

    model_config = ConfigDict(extra="allow")

    @property
    def settings(self) -> dict[str, Any]:
        """The settings other than the table's own keys."""
        return dict(self.model_extra or {})


class Vehicle(Table):
    """A vehicle, its sample time and its effects.

    file: of a vehicle, beside the campaign file.  effects: values by path, with or without the leading `effects.`.
    """

    preset: str | None = None
    file: str | None = None
    dt_s: float | None = Field(None, gt=0.0)
    effects: dict[str, float] = {}

    @field_validator("effects")
    @classmethod
    def _full_paths(cls, given: dict[str, float]) -> dict[str, float]:
        return {path if path.startswith("effects.") else f"effects.{path}": value for path, value in given.items()}

    @model_validator(mode="after")
    def _one_source(self) -> Vehicle:
        if (self.preset is None) == (self.file is None):
            got = "none" if self.preset is None else "both"
            raise ValueError(f"needs either preset or file, got {got}")
        return self


class EnvExperiment(Table):
    """An episode of an environment; settings that are not given are the environment's defaults.

    targets: for each channel the steps, pairs of time in s and value, or "drawn" for those of the environment.
    """

    kind: Literal["env"]
    id: str
    duration_s: float | None = Field(None, gt=0.0)
    actions: tuple[str, ...] | None = None
    start: dict[str, float] = {}
    target: float | None = None
    targets: dict[str, Literal["drawn"] | Steps] = {}
    waypoints: tuple[tuple[float, float, float], ...] | None = None
    near: Pair | None = None
    depths: Pair | None = None
    randomise: dict[str, Pair] | None = None
    compass_noise_rad: float | None = Field(None, ge=0.0)
    speed_mps: float | Pair | None = None

    @property
    def env_id(self) -> str:
        """Gymnasium's name of the environment: `auv_gym/Depth-v0` for `Depth`."""
        return self.id if "/" in self.id else f"auv_gym/{self.id}-v0"

    @property
    def steps(self) -> dict[str, Steps]:
        """The targets that are given as steps, by channel."""
        return {name: given for name, given in self.targets.items() if not isinstance(given, str)}


class MissionExperiment(OpenTable):
    """The standard experiment of the vehicle's family, as `auv-gym simulate` runs it, with its settings."""

    kind: Literal["mission"]


class LogExperiment(Table):
    """A measured log beside the campaign file, or slocum:NAME; see `auv_gym.records.reading.read_record`."""

    kind: Literal["log"]
    file: str
    mapping: dict[str, str | float | dict[str, str | float]] | None = None
    max_gap_s: float | None = Field(None, gt=0.0)
    cut_gaps: bool = True


Experiment = Annotated[EnvExperiment | MissionExperiment | LogExperiment, Field(discriminator="kind")]


class Controller(OpenTable):
    """An autopilot (`controllers.autopilots`) with its settings; gains_file: beside the campaign file."""

    kind: Literal["pid", "s_plane", "gpc"] = "pid"
    gains_file: str | None = None


class Excitation(OpenTable):
    """A signal (`experiments.excitation`) with its settings, added to a command or a set point from start_s on."""

    kind: str
    at: str
    start_s: float = Field(0.0, ge=0.0)


class Envelope(OpenTable):
    """Limits [low, high] by channel, and the settings of `controllers.composed.envelope`, which are not pairs."""

    @property
    def limits(self) -> dict[str, tuple[float, float]]:
        return {name: tuple(given) for name, given in self.settings.items() if isinstance(given, list)}

    @property
    def options(self) -> dict[str, Any]:
        return {name: given for name, given in self.settings.items() if not isinstance(given, list)}

    @model_validator(mode="after")
    def _pairs(self) -> Envelope:
        for name, given in self.settings.items():
            if isinstance(given, list):
                numbers = [v for v in given if isinstance(v, int | float) and not isinstance(v, bool)]
                if len(given) != 2 or len(numbers) != 2 or not given[0] < given[1]:
                    raise ValueError(f"{name} needs a pair [low, high] of numbers, got {given!r}")
        if not self.limits:
            raise ValueError("needs limits, such as depth_m = [2.0, 18.0], got none")
        return self


class RunSettings(Table):
    """Everything that one run depends on.

    sensors: for environments, `effects.sampling` by sensor and effect, such as depth.noise.
    """

    vehicle: Vehicle | None = None
    experiment: Experiment
    controller: Controller | None = None
    excitation: tuple[Excitation, ...] = ()
    envelope: Envelope | None = None
    sensors: dict[str, float] = {}
    seed: int = Field(ge=0)

    @property
    def files(self) -> tuple[str, ...]:
        """The vehicle and controller files, beside the campaign file."""
        vehicle = self.vehicle.file if self.vehicle is not None else None
        gains = self.controller.gains_file if self.controller is not None else None
        return tuple(name for name in (vehicle, gains) if name is not None)

    @model_validator(mode="after")
    def _parts_of_an_experiment(self) -> RunSettings:
        kind = self.experiment.kind
        given = [name for name in ("controller", "excitation", "envelope", "sensors") if getattr(self, name)]
        if kind != "env" and given:
            raise ValueError(f"{given[0]} is for experiments of kind 'env', got one of kind {kind!r}: leave it out")
        if kind == "env" and self.controller is None:
            raise ValueError("an experiment of kind 'env' needs a table [controller], such as kind = \"pid\"")
        if kind == "mission" and self.vehicle is None:
            raise ValueError("an experiment of kind 'mission' needs a table [vehicle] with a preset or a file")
        return self


Filter = dict[str, Any]  # "seeds" or a key of the grid -> a value or a list of values; empty: all runs


class Fit(Table):
    """A model to fit; runs and validate select the runs for fitting and testing, `each` asks for one model per value.

    runs, validate: see `plan.selected`; the default of validate is the other runs of the same cells.  each: keys of the
    grid.
    """

    name: str
    method: str
    settings: dict[str, Any] = {}
    inputs: tuple[str, ...] | None = None
    outputs: tuple[str, ...] | None = None
    runs: Filter = {}
    validate_on: Filter | None = Field(None, alias="validate")
    each: tuple[str, ...] = ()


class Compare(Table):
    """The comparisons of the fitted models with the vehicle, and the runs to make them on."""

    open_loop: bool = True
    closed_loop: bool = False
    runs: Filter = {}


class Tune(Table):
    """Gains for a fitted vehicle, assessed over the intervals of its parameters; see `controllers.tuning`."""

    fit: str
    kind: Literal["pid", "gpc"] = "pid"
    require: tuple[str, ...] = ()
    evaluations: int = Field(25, ge=0)
    draws: int = Field(12, ge=0)
    seed: int = Field(0, ge=0)


class Head(Table):
    """The part of a campaign file that applies to all runs."""

    name: str
    description: str = ""
    seeds: Annotated[int, Field(ge=1)] | Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)] = 1
    grid: dict[str, Annotated[list[Any], Field(min_length=1)]] = {}
    fit: tuple[Fit, ...] = ()
    compare: Compare | None = None
    tune: Tune | None = None

    @field_validator("name")
    @classmethod
    def _plain(cls, name: str) -> str:
        if not re.fullmatch(r"[\w.-]+", name):
            raise ValueError(f"needs letters, digits, '-', '_' and '.' only, got {name!r}")
        return name

    @field_validator("fit")
    @classmethod
    def _own_names(cls, fits: tuple[Fit, ...]) -> tuple[Fit, ...]:
        names = [fit.name for fit in fits]
        for name in names:
            if not re.fullmatch(r"[\w.-]+", name):
                raise ValueError(f"names need letters, digits, '-', '_' and '.' only, got {name!r}")
            if names.count(name) > 1:
                raise ValueError(f"two models have the name {name!r}: give each a name of its own")
        return fits

    @model_validator(mode="after")
    def _one_fit_to_tune(self) -> Head:
        fits = {fit.name: fit for fit in self.fit}
        if self.tune is not None and (self.tune.fit not in fits or fits[self.tune.fit].each):
            known = ", ".join(name for name, fit in fits.items() if not fit.each) or "none"
            raise ValueError(f"tune.fit needs the name of a fit of one model ({known}), got {self.tune.fit!r}")
        return self


@final
@dataclass(frozen=True, eq=False)
class Campaign:
    """A campaign file: the settings that all runs share, `template`, and what is varied.

    path: of the file; relative paths in it start at `folder`.  text: the original content.
    """

    path: Path
    text: str
    name: str
    description: str
    seeds: tuple[int, ...]
    grid: Mapping[str, Sequence[Any]]
    fit: tuple[Fit, ...]
    compare: Compare | None
    tune: Tune | None
    template: Mapping[str, Any]

    @property
    def folder(self) -> Path:
        """The folder of the campaign file."""
        return self.path.resolve().parent
