"""Kinds of part, and the registry that finds them.

A kind is one module with one `KIND`. The package `parts` has those of auv-gym; a distribution adds its own by an entry
point of the group `auv_gym.parts` that names a `PartKind`, a script by `register_part`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from typing import Any, Literal, NamedTuple

import numpy as np

from auv_gym.compiled import compiled
from auv_gym.param import did_you_mean

# No force: x + -0.0 equals x bit for bit, so that a compiler may omit the sum, unlike with 0.0.
NONE = -0.0
Role = Literal["", "yaw", "pitch", "surge"]
Inside = Literal["", "volume", "slide", "turn"]


class Motion(NamedTuple):
    """The quantities that a part's force may depend on; all velocities through the water, in body axes, m/s and rad/s.

    density: of the water over that of the coefficients; water: the same in kg/m^3.  gravity: m/s^2.  depth: m.
    r11 to r33: the rotation from body axes to north, east, down.  sag: V, by which the supply is below its stated
    value.
    """

    u: float
    v: float
    w: float
    p: float
    q: float
    r: float
    density: float
    water: float
    gravity: float
    depth: float
    r11: float
    r12: float
    r13: float
    r21: float
    r22: float
    r23: float
    r31: float
    r32: float
    r33: float
    sag: float = 0.0


class Block(NamedTuple):
    """A mass that moves in the body, with its position and motion; body axes, about the body's origin.

    mass: kg.  x, y, z: its centre, m; v_*: its velocity, m/s, and a_*: acceleration, m/s^2, relative to the body.
    spin: rate of its rotation about x, rad/s.  i_*: inertia about its own centre, kg m^2; i_yz has a plus sign, as an
    element of the inertia tensor.
    """

    mass: float
    x: float
    y: float
    z: float
    v_x: float
    v_y: float
    v_z: float
    a_y: float
    a_z: float
    spin: float
    i_xx: float
    i_yy: float
    i_zz: float
    i_yz: float


@dataclass(frozen=True)
class Command:
    """An input of a part.

    suffix: of its channel, which is the part's name plus this suffix, or a channel given explicitly or in the file.
    role: its use by autopilots and environments: "yaw", "pitch", "surge".  limits: function from the part's parameters
    to the lowest and highest command, in the channel's unit.  rest: the parameter with the resting command; without
    one, it rests at `idle`.  required: whether a record must have it; a missing optional input is at rest.  design: the
    parameter with the command at the design speed.  inside: what it moves inside the hull: the displaced volume, or a
    mass that slides or turns.  quantity: what it sets of a part with several commands, such as the angle.
    """

    suffix: str
    limits: Callable[[Any], tuple[float, float]]
    role: Role = ""
    rest: str = ""
    required: bool = True
    design: str = ""
    channel: str = ""
    idle: float = 0.0
    inside: Inside = ""
    quantity: str = ""


class Sketch(NamedTuple):
    """A line of a part's drawing: points in body axes, m."""

    points: tuple[tuple[float, float, float], ...]


def blades(x: float, y: float, z: float, half_chord: float, span: float, axis: Role) -> Sketch:
    """A pair of fins about a position, m: vertical with axis "yaw", otherwise horizontal."""
    corners = ((-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1))
    upright = axis == "yaw"
    return Sketch(
        tuple((x + i * half_chord, y if upright else y + j * span, z + j * span if upright else z) for i, j in corners)
    )


@compiled
def force_at(x, y, z, at_x, at_y, at_z):
    """A force, N, with its moment about the origin, N m, in a part's return format; at_*: point of action, m."""
    return x, y, z, at_y * z - at_z * y, at_z * x - at_x * z, at_x * y - at_y * x


@compiled
def no_shape(command, memory, part, effects, index):
    """The unchanged command, for a part without an actuator."""
    return command, command


@compiled
def no_times(part, effects, index):
    """No dead time, lag or rate limit."""
    return 0.0, 0.0, 0.0


def _no_problem(part: Any) -> str:
    return ""


def _no_problem_with_hull(part: Any, hull: Any) -> str:
    return ""


def _no_sketch(part: Any) -> tuple[Sketch, ...]:
    return ()


def _whole(part: Any, shared: Mapping[str, float]) -> float:
    return 1.0


@dataclass(frozen=True, eq=False)
class PartKind:
    """A kind of part: its parameters and effects, its commands, and its compiled functions.

    `part`, `effects` and `derived` are the records of one part of the kind; `at` is the index of its first actuator.

    force(at, actuators, inputs, shared, motion, part, effects, derived): a tuple of X, Y, Z in N and K, M, N in N m
        about the body's origin, `NONE` for no force; shared: index in inputs of the first of `shared`.
    shape(command, memory, part, effects, index): a command after its instantaneous effects, and the memory.
    times(part, effects, index): dead time, s, lag, s, slowness, s per unit, of command `index`.
    derive(part, effects, hull, derived): fills the numbers listed in `numbers`, which do not change in a run.
    wake(at, actuators, u, part, effects): the speed that a propeller adds to the flow behind it, m/s, at the speed u;
    if
        it has a wake, this is not 0 at u = 1 and rest, see `physics.propulsion.slipstream_speed`.
    in_wake(at, actuators, wake, motion, part, effects): the force that the wakes of all propellers, m/s, add to the
    part's.
    block(at, rates_at, actuators, part, effects): a mass that moves in the body, as a `Block`; rates_at: index of the
        first rate of its actuators, which follow their positions.
    damping(part, effects, derived, water, inverse_mass, rates): adds the decay rates of the velocities to rates, (6,
    4):
        1/s, constant, per |u|, per own speed, per u^2; for the stable step.

    Functions that a kind does not need are None. with_hull: whether its forces are added to those of the hull, like
    flow forces, or to the loads, like those of a drive; this changes the order of a sum.
    slot: kinds of one slot share their compiled code.  order: of the kinds in a vehicle.
    coefficients: parameters that a first fit frees, of the first part of the kind.  doubted: those of every part that
    are equally uncertain.  twins: effects that are equivalent to a parameter of the part.  same: effects that only
    change one parameter: its name, and its value as a function of the given value and the effect's size.
    choice, variants: the key of a part's table that chooses one of several forms.
    shared: inputs that all parts of the kind read and nothing moves, and the parameter that gives each if a record does
    not have it; "" for 0 or, for `elapsed_s`, the time that has passed.
    texts: parameters that a file may give in words or rows, and the functions that make entries of them.
    problem: words about impossible numbers, or nothing; `{}` in them is the part's name.
    problem_with_hull: the same about the part together with the hull.  sketch: lines to draw.
    place: the parameters with the part's position.
    thrusts: for a part whose thrust along a line depends only on its command: its commands in the channel's unit,
    rising, and the thrust at each, N, at the supply voltage of the part's numbers; linear between.  Its `numbers` begin
    with the force and moment of a thrust of 1 N: x, y, z, k, m, n.  thrust_share: the factor by which the shared
    inputs, by channel, multiply it.
    polar: function from a part to drag_0, drag_2, lift_1 and lift_0 of the whole vehicle, which give its steady glide,
    or None.
    """

    name: str
    title: str
    parameters: type
    effects: type
    order: int = 100
    commands: tuple[Command, ...] = ()
    force: Any = None
    shape: Any = no_shape
    times: Any = no_times
    derive: Any = None
    wake: Any = None
    in_wake: Any = None
    block: Any = None
    damping: Any = None
    numbers: tuple[str, ...] = ()
    with_hull: bool = False
    slot: str = ""
    coefficients: tuple[str, ...] = ()
    doubted: tuple[str, ...] = ()
    twins: Mapping[str, str] = field(default_factory=dict)
    same: Mapping[str, tuple[str, Callable[[float, float], float]]] = field(default_factory=dict)
    choice: str = ""
    variants: Mapping[str, PartKind] = field(default_factory=dict)
    shared: Mapping[str, str] = field(default_factory=dict)
    texts: Mapping[str, Callable[[Any], Mapping[str, Any]]] = field(default_factory=dict)
    problem: Callable[[Any], str] = _no_problem
    problem_with_hull: Callable[[Any, Any], str] = _no_problem_with_hull
    sketch: Callable[[Any], tuple[Sketch, ...]] = _no_sketch
    place: tuple[str, ...] = ()
    thrusts: Callable[[Any], tuple[np.ndarray, np.ndarray]] | None = None
    thrust_share: Callable[[Any, Mapping[str, float]], float] = _whole
    polar: Callable[[Any], tuple[float, float, float, float] | None] | None = None

    def __post_init__(self):
        if not self.name.isidentifier():
            raise ValueError(f"A kind of part needs a name that is an identifier, got {self.name!r}.")
        object.__setattr__(self, "slot", self.slot or self.name)
        if self.force is None and not self.variants:
            raise ValueError(f"The kind of part {self.name!r} needs a force, or variants that have one.")


_REGISTERED: dict[str, PartKind] = {}


def register_part(kind: PartKind) -> PartKind:
    """Register a kind of part by its name; returns it.  Raises ValueError if the name is taken."""
    if (_REGISTERED.get(kind.name) or _found().get(kind.name) or kind) is not kind:
        raise ValueError(
            f"There is a kind of part {kind.name!r} already: choose another name, or start Python anew where you have "
            "changed it."
        )
    _REGISTERED[kind.name] = kind
    return kind


def part_kinds() -> dict[str, PartKind]:
    """All kinds of part by name."""
    return dict(sorted({**_found(), **_REGISTERED}.items(), key=lambda item: (item[1].order, item[0])))


def part_kind(name: str, choice: str = "") -> PartKind:
    """The kind of this name, or its chosen variant; raises ValueError if there is none."""
    kind = _REGISTERED.get(name) or _found().get(name)
    if kind is None:
        kinds = part_kinds()
        raise ValueError(f"there is no kind of part {name!r}. {did_you_mean(name, kinds)}Kinds: {', '.join(kinds)}")
    if not kind.variants:
        return kind
    if choice not in kind.variants:
        known = ", ".join(kind.variants)
        raise ValueError(f"a part of kind {name!r} needs {kind.choice} = one of {known}, got {choice!r}")
    return kind.variants[choice]


@lru_cache
def _found() -> dict[str, PartKind]:
    parts = import_module("auv_gym.vehicles.body.parts")
    kinds = [import_module(f"{parts.__name__}.{found.name}").KIND for found in iter_modules(parts.__path__)]
    kinds += [entry.load() for entry in entry_points(group="auv_gym.parts")]
    return {kind.name: kind for kind in kinds}
