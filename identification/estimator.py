"""Identification methods by name: settings in the constructor, records into `fit`, a new result out."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import MISSING, Field, dataclass, fields
from importlib import import_module
from importlib.metadata import entry_points
from math import isfinite
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Any, Literal, Protocol, Union, get_args, get_origin, get_type_hints, runtime_checkable

from auv_gym.param import did_you_mean, listed

if TYPE_CHECKING:
    from auv_gym.model import Model
    from auv_gym.plant import Plant
    from auv_gym.records.record import Record
    from identification.estimate import Estimate

GROUP = "auv_gym.methods"
# Fields of an estimator for the vehicle and channels; all others are settings.
_GIVEN = ("plant", "inputs", "outputs")


class Fit(Protocol):
    """The result of a fit; `model` runs wherever a Model runs, and the estimates give its parameters' uncertainty."""

    @property
    def model(self) -> Model: ...

    @property
    def estimates(self) -> tuple[Estimate, ...]: ...


@runtime_checkable
class Noted(Protocol):
    """A fit with remarks for its reader."""

    @property
    def notes(self) -> tuple[str, ...]: ...


class Estimator(Protocol):
    """A method with its settings; `fit` changes nothing in it and raises ValueError if the data are unsuitable."""

    def fit(self, *records: Record) -> Fit: ...


@dataclass(frozen=True)
class Setting:
    """A setting of a method: its name, a description of its type, and its default; needed: it has no default."""

    name: str
    type: str
    default: Any
    needed: bool


@dataclass(frozen=True)
class Method:
    """A method of identification.

    estimator: a frozen dataclass with `fit`, or its import path `module:Class`, imported on use.  Its fields are the
    settings; the fields plant, inputs and outputs, if it has them, are filled with the vehicle and channels.
    listed: names of the settings, with a star for required ones, for lists that should not import the class.
    problem: why a method of another package cannot be used.
    """

    name: str
    title: str
    estimator: type | str
    problem: str = ""
    listed: str = ""

    def load(self) -> Any:
        """The estimator's class; raises ValueError if it is not available."""
        if self.problem:
            raise ValueError(f"Method {self.name} cannot be used: {self.problem}")
        if not isinstance(self.estimator, str):
            return self.estimator
        module, _, name = self.estimator.partition(":")
        return getattr(import_module(module), name)

    @property
    def needs_vehicle(self) -> bool:
        """Whether it fits parameters of a vehicle, which must be given."""
        return any(field.name == "plant" and _needed(field) for field in fields(self.load()))

    @property
    def needs_channels(self) -> bool:
        """Whether inputs and outputs must be given; other methods know theirs."""
        return any(field.name in ("inputs", "outputs") and _needed(field) for field in fields(self.load()))

    @property
    def setting_names(self) -> str:
        """The names of the settings, with a star for required ones, separated by commas."""
        return self.listed or ", ".join(f"{s.name}{'*' * s.needed}" for s in self.settings.values())

    @property
    def settings(self) -> dict[str, Setting]:
        """The settings by name."""
        made = self.load()
        hints = get_type_hints(made)
        return {
            field.name: Setting(field.name, _words(hints[field.name]), _default(field), _needed(field))
            for field in fields(made)
            if field.name not in _GIVEN and field.init
        }


_BUILT_IN = (
    Method(
        "grey_box",
        "Fits chosen parameters of a vehicle to one-step predictions, with sensor and process noise.",
        "identification.fit.greybox:GreyBox",
        listed="free*, window, max_iterations, process, doubt",
    ),
    Method(
        "arx",
        "Linear difference equations by least squares; biased by measurement noise.",
        "identification.linear.polynomials.arx:Arx",
        listed="n_a, n_b, delay, offset, structure, integrating, skip",
    ),
    Method(
        "els",
        "ARMAX by extended least squares, regressed on its own errors.",
        "identification.linear.polynomials.els:Els",
        listed="n_a, n_b, n_c, delay, offset, structure, integrating, skip",
    ),
    Method(
        "armax",
        "ARMAX by the prediction-error method: without bias in closed loop and under coloured noise.",
        "identification.linear.polynomials.armax:Armax",
        listed="n_a, n_b, n_c, delay, offset, structure, integrating, skip, stopping",
    ),
    Method(
        "output_error",
        "Free runs fitted, for noise on the measurement alone; not for unstable plants.",
        "identification.linear.polynomials.output_error:OutputError",
        listed="n_a, n_b, delay, offset, structure, integrating, skip, stopping",
    ),
    Method(
        "n4sid",
        "State space by subspaces, order by singular values; biased in closed loop.",
        "identification.linear.subspaces.n4sid:N4sid",
        listed="order, horizon, weight, integrators, offset, stable, refine",
    ),
    Method(
        "pbsid",
        "State space by subspaces of the predictor, without bias in closed loop.",
        "identification.linear.subspaces.pbsid:Pbsid",
        listed="order, horizon, integrators, offset, stable, refine",
    ),
    Method(
        "rwls",
        "A float's diving model by recursive weighted least squares; biased by depth noise.",
        "identification.recursive.rwls:Rwls",
        listed="forgetting, initial, spread, known",
    ),
    Method(
        "ivls",
        "The diving model by instrumental variables as published; fails with noise; included for comparison.",
        "identification.recursive.ivls:Ivls",
        listed="share, lag, initial, spread, known",
    ),
    Method(
        "corrected_ivls",
        "The same with a bounded instrument and integrated rows; sample by sample or over records.",
        "identification.recursive.corrected_ivls:CorrectedIvls",
        listed="lag, memory, smoothing, slowest, fastest, passes, warm_up, share, initial, spread, known",
    ),
    Method(
        "refined_iv",
        "The diving model over whole records, without bias and as accurate as white noise allows.",
        "identification.recursive.refined_iv:RefinedIv",
        listed="slowest, fastest, max_iterations, initial, known",
    ),
    Method(
        "ls_svm",
        "The diving model by a support vector machine with a linear kernel; biased by depth noise.",
        "identification.kernel_machines.ls_svm:LsSvm",
        listed="penalty",
    ),
    Method(
        "hull_ls_svm",
        "A torpedo's hull forces by a support vector machine; mass, fins and propulsion stay the vehicle's.",
        "identification.kernel_machines.hull.hull:HullLsSvm",
        listed="penalty, sigma, tuning, size, samples, separate, mirrored, trend",
    ),
    Method(
        "narx_ls_svm",
        "Nonlinear difference equations by support vector machines, chosen by free runs; a black box.",
        "identification.kernel_machines.narx.narx:NarxLsSvm",
        listed="n_a, n_b, delay, integrating, trend, penalty, sigma, tuning, samples",
    ),
)


def list_methods() -> dict[str, Method]:
    """All methods by name: built-in ones, and those of the entry point group `auv_gym.methods`, each a `Method`.

    A method that cannot be loaded is included with its problem.

    Example:

        >>> from identification import list_methods
        >>> list(list_methods())[:4]
        ['grey_box', 'arx', 'els', 'armax']
    """
    found = {method.name: method for method in _BUILT_IN}
    for entry in entry_points(group=GROUP):
        offered = _loaded(entry.name, entry.value, entry.load)
        if entry.name in found:
            name = f"{entry.name} ({entry.value})"
            problem = f"{entry.value} offers a method under the taken name {entry.name!r}: rename it there."
            offered = Method(name, offered.title, offered.estimator, problem)
        found[offered.name] = offered
    return found


def make_estimator(
    name: str,
    settings: Mapping[str, Any] | None = None,
    *,
    plant: Plant | None = None,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
) -> Estimator:
    """Make the estimator of a method from its name and settings; raises ValueError if a setting is not known.

    settings: values by name; text is parsed by the setting's type.  plant: the vehicle whose parameters `grey_box`
    frees, by default those that a first fit of such a vehicle frees.  inputs, outputs: channels, for methods that need
    them.

    Example:

        >>> from identification import make_estimator
        >>> arx = make_estimator("arx", {"n_a": 3}, inputs=["rudder_rad"], outputs=["heading_rad"])
        >>> arx.n_a, arx.n_b
        (3, 2)
    """
    known = list_methods()
    name = name.strip().replace("-", "_")
    if name not in known:
        raise ValueError(f"No method {name!r}. {did_you_mean(name, known)}Methods: {', '.join(known)}.")
    method = known[name]
    made, given = method.load(), dict(settings or {})
    for key in given:
        if key not in method.settings:
            raise ValueError(
                f"Method {name} has no setting {key!r}. {did_you_mean(key, method.settings)}{_allowed(method)}"
            )
    if name == "grey_box" and "free" not in given and plant is not None:
        given["free"] = plant.coefficients
    work = _worked_on(method, {"plant": plant, "inputs": inputs, "outputs": outputs})
    hints = get_type_hints(made)
    values = {key: _converted(name, key, value, hints[key]) for key, value in given.items()}
    for field in fields(made):
        if field.name in method.settings and _needed(field) and field.name not in values:
            raise ValueError(f"Method {name} needs the setting {field.name!r}. {_allowed(method)}")
    return made(**values, **work)


def parse_settings(texts: Iterable[str]) -> dict[str, Any]:
    """Settings from `key=value` texts: values as in TOML, a comma makes a list, other text stays text."""
    found: dict[str, Any] = {}
    for text in texts:
        key, separator, value = (part.strip() for part in text.partition("="))
        if not separator or not key:
            raise ValueError(f"A setting needs KEY=VALUE, such as n_a=3, got {text!r}.")
        if key in found:
            raise ValueError(f"Setting {key!r} came twice: give it once.")
        for written in (value, f"[{value}]"):
            try:
                found[key] = tomllib.loads(f"value = {written}")["value"]
                break
            except tomllib.TOMLDecodeError:
                continue
        else:
            found[key] = [part.strip() for part in value.split(",")] if "," in value else value
    return found


def summary(fit: Fit) -> str:
    """A fit in text: the model's channels, its parameters with 95 % intervals, and notes, one per line.

    Example:

        >>> import numpy as np
        >>> from auv_gym import load_vehicle
        >>> from identification import Arx, closed_loop, summary
        >>> log = closed_loop(load_vehicle("slocum"), rng=np.random.default_rng(0))
        >>> print(summary(Arx(["rudder_rad"], ["heading_rad"]).fit(log)))
        rudder_rad -> heading_rad, dt 4 s
        a1[heading_rad]              -1.64997  [-1.73568, -1.56425]
        a2[heading_rad]              0.647045  [0.560224, 0.733867]
        b1[heading_rad, rudder_rad]  0.0281101  [0.0131621, 0.043058]
        b2[heading_rad, rudder_rad]  0.0290262  [0.0116492, 0.0464033]
        intercept[heading_rad]       -0.00122159 rad  [-0.00460077, 0.00215759]
    """
    model = fit.model
    lines = [f"{', '.join(model.inputs)} -> {', '.join(model.outputs)}, dt {model.dt:g} s"]
    width = max((len(e.path) for e in fit.estimates), default=0)
    for e in fit.estimates:
        low, high = e.ci95
        span = f"[{low:.6g}, {high:.6g}]" if isfinite(low) and isfinite(high) else "no interval"
        unit = "" if e.unit == "1" else f" {e.unit}"
        lines.append(f"{e.path:<{width}}  {e.value:.6g}{unit}  {span}" + (f"  ({e.problem})" if e.problem else ""))
    return "\n".join([*lines, *notes_of(fit)])


def notes_of(fit: Fit) -> tuple[str, ...]:
    """The remarks of a fit; most have none."""
    return tuple(fit.notes) if isinstance(fit, Noted) else ()


def _worked_on(method: Method, given: Mapping[str, Any]) -> dict[str, Any]:
    """Values of the fields plant, inputs and outputs."""
    values = {}
    has = {field.name: field for field in fields(method.load())}
    for what, value in given.items():
        if what in has and value is not None:
            values[what] = value if what == "plant" else tuple(value)
        elif what in has and _needed(has[what]):
            hint = "a preset or a vehicle file" if what == "plant" else "channel names, such as stern_plane_rad"
            raise ValueError(f"Method {method.name} needs {'a vehicle' if what == 'plant' else what}: give {hint}.")
        elif value is not None and what != "plant":
            raise ValueError(f"Method {method.name} knows its own {what}, got {', '.join(value)}: leave them out.")
    return values


def _loaded(name: str, value: str, load: Any) -> Method:
    """The method of an entry point, or one with a description of its problem."""
    try:
        method = load()
        if not isinstance(method, Method):
            raise ValueError(f"it is a {type(method).__name__}, not an identification.estimator.Method")
        if method.name != name:
            raise ValueError(f"it calls itself {method.name!r}")
        _ = method.settings, method.load().fit  # raises for a class without them
    except Exception as error:  # an error in another package must not affect the built-in methods
        return Method(name, f"from {value}", value, f"its entry point {value} is broken: {error}.")
    return method


def _converted(method: str, key: str, value: Any, hint: Any) -> Any:
    """A setting's value converted to its type: whole numbers to floats if needed, lists to tuples."""
    from pydantic import TypeAdapter, ValidationError

    value = _tuples(value)
    expected = TypeAdapter(hint)
    try:
        return expected.validate_python(value)
    except ValidationError as error:
        if isinstance(value, str | int | float):
            with suppress(ValidationError):  # a single value may mean a list of one
                return expected.validate_python((value,))
        raise ValueError(f"Method {method} cannot take {key} = {value!r}: give {_words(hint)}.") from error


def _tuples(value: Any) -> Any:
    return tuple(_tuples(item) for item in value) if isinstance(value, list) else value


def _allowed(method: Method) -> str:
    described = [
        f"{s.name} ({s.type}, {'needed' if s.needed else f'default {s.default!r}'})" for s in method.settings.values()
    ]
    return f"Settings: {'; '.join(described) or 'none'}."


def _words(hint: Any) -> str:
    """A type in words: "a whole number or a list of whole numbers"."""
    within = get_args(hint)
    if get_origin(hint) in (Literal, Union, UnionType):
        words = [str(one) if get_origin(hint) is Literal else _words(one) for one in within]
        return listed(words, "or")
    if within and get_origin(hint) in (list, tuple, Sequence):
        return f"a list of {_several(within[0])}"
    return f"a {_NAMED[hint]}" if hint in _NAMED else {bool: "true or false", NoneType: "none"}.get(hint, hint.__name__)


def _several(hint: Any) -> str:
    """A type in words, in the plural."""
    within = get_args(hint)
    return f"lists of {_several(within[0])}" if within else f"{_NAMED.get(hint, hint.__name__)}s"


_NAMED = {int: "whole number", float: "number", str: "text"}


def _needed(field: Field[Any]) -> bool:
    return field.default is MISSING and field.default_factory is MISSING


def _default(field: Field[Any]) -> Any:
    if field.default is not MISSING:
        return field.default
    return None if field.default_factory is MISSING else field.default_factory()
