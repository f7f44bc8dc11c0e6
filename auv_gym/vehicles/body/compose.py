"""The family of a vehicle in six degrees of freedom: a hull and the parts that its file names.

Parts of one kind lie side by side in the parameters, so that compiled code sees them as an array of records; how many
there are is a constant of that code. What depends on the kinds is bound pairwise, a chain with a link for each kind,
and cached by the counts: two vehicles with as many parts of the same kinds share their code.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields as dataclass_fields, make_dataclass
from functools import lru_cache
from itertools import groupby
from keyword import iskeyword
from typing import Any

import numpy as np

from auv_gym.channels import declare_input
from auv_gym.compiled import bind, view_as
from auv_gym.effects import BodyEffects
from auv_gym.param import list_paths, pack, part, record_type, value_at
from auv_gym.vehicles.body import blocks, derived as derived_numbers, dynamics, sums
from auv_gym.vehicles.body.hull import Hull
from auv_gym.vehicles.body.kinds import Command, PartKind, part_kind
from auv_gym.vehicles.body.sensors import SENSORS, output, sense, settle_sensors
from auv_gym.vehicles.family import Family, RightHandSide, no_kick

RESERVED = ("hull", "parts", *(field.name for field in dataclass_fields(BodyEffects)))  # names that a part cannot have
STATES = (
    *("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps"),
    *("north_m", "east_m", "depth_m", "roll_rad", "pitch_rad", "heading_rad", "wave_phase_rad"),
)
OUTPUTS = (
    *("roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps"),
    *("u_mps", "v_mps", "w_mps", "u_dvl_mps", "v_dvl_mps", "w_dvl_mps", "north_m", "east_m", "depth_m"),
)
_SPEEDS = STATES[:3]
_HOVERING = (*_SPEEDS, "p_radps", "q_radps", "roll_rad", "pitch_rad")  # what commands move from rest
_AXES = ("surge", "sway", "heave", "roll", "pitch", "yaw")
_HULL_COEFFICIENTS = (
    *("hull.surge.u_u", "hull.sway.uv", "hull.sway.ur", "hull.heave.uw", "hull.heave.uq"),
    *("hull.pitch.uw", "hull.pitch.uq", "hull.yaw.uv", "hull.yaw.ur"),
)

# likewise of a hull that thrusters move in all directions: its drag
_DRAG_COEFFICIENTS = tuple(
    f"hull.{axis}.{term}"
    for axis, velocity in zip(_AXES, "uvwpqr", strict=True)
    for term in (velocity, f"{velocity}_{velocity}")
)

# the time in which drag stops a vehicle that hovers, s, and the speed from which its square does, m/s or rad/s
_STOPS_IN_S, _STOPS_FROM = 1.0, 0.3

# of the hull, where coefficients are that a first fit does not free, but that are known no better
_DOUBTED = ("i_xx", "i_yy", "i_zz", "added_mass.", *(f"{axis}." for axis in _AXES), "cross_flow.drag")


@dataclass(frozen=True)
class Part:
    """A part as a vehicle file names it: its kind, the form of the kind, and the channels of its commands."""

    name: str
    kind: str
    choice: str = ""
    channels: tuple[str, ...] = ()

    @property
    def found(self) -> PartKind:
        return part_kind(self.kind, self.choice)

    @property
    def title(self) -> str:
        """`stern plane`; a name with abbreviations or numbers, such as `th_ap`, as the file has it."""
        words = self.name.split("_")
        return " ".join(words) if all(len(word) > 2 for word in words) else self.name

    def channel(self, index: int) -> str:
        """The channel of one of its commands."""
        if index < len(self.channels) and self.channels[index]:
            return self.channels[index]
        command = self.found.commands[index]
        return command.channel or f"{self.name}_{command.suffix}"


@dataclass(frozen=True)
class Body:
    """What a family in six degrees of freedom knows of its parts, in the order of its parameters."""

    parts: tuple[Part, ...]

    @property
    def commands(self) -> tuple[tuple[Part, int, Command], ...]:
        """All commands in the order of the inputs: the part, which of its commands, and what it is."""
        return tuple((part, i, c) for part in self.parts for i, c in enumerate(part.found.commands))

    def by_role(self) -> dict[str, tuple[str, ...]]:
        """The channels that serve each role, in the order of the inputs."""
        roles: dict[str, tuple[str, ...]] = {}
        for part_, i, command in self.commands:
            if command.role:
                roles[command.role] = (*roles.get(command.role, ()), part_.channel(i))
        return roles

    def by_inside(self) -> dict[str, tuple[str, ...]]:
        """The channels that move each thing inside of the hull, see `Command.inside`, in the order of the inputs."""
        moved: dict[str, tuple[str, ...]] = {}
        for part_, i, command in self.commands:
            if command.inside:
                moved[command.inside] = (*moved.get(command.inside, ()), part_.channel(i))
        return moved

    @property
    def thrusters(self) -> tuple[Part, ...]:
        """The parts that push along a line by their command alone."""
        return tuple(part_ for part_ in self.parts if part_.found.thrusts is not None)

    @property
    def steered(self) -> bool:
        """Whether parts steer it in yaw and in pitch, and drive it."""
        return {"yaw", "pitch", "surge"} <= self.by_role().keys()

    @property
    def hovers(self) -> bool:
        """Whether thrusters do everything, and no part steers or drives by its role."""
        return bool(self.thrusters) and not self.by_role()

    @property
    def glides(self) -> bool:
        """Whether its volume, and masses that slide and turn in it, do everything: no part steers, drives or pushes."""
        return {"volume", "slide", "turn"} <= self.by_inside().keys() and not self.by_role() and not self.thrusters

    @property
    def piloted(self) -> bool:
        """Whether autopilots and environments know how to move it: by fins and a drive, thrusters or masses alone."""
        return self.steered or self.hovers or self.glides

    @property
    def kind(self) -> str:
        """The kind of the vehicle, by what moves it."""
        return "hover" if self.hovers else "glide_body" if self.glides else "body"

    def required(self) -> tuple[str, ...]:
        """The channels that a record must have; a second part of a role, such as bow planes, rests where it lacks."""
        first = {names[0] for names in self.by_role().values()}
        named = [(part_.channel(i), command) for part_, i, command in self.commands]
        return tuple(name for name, command in named if command.required and (not command.role or name in first))

    def ranges(self, parameters: Any) -> np.ndarray:
        """The lowest command, that at rest and the highest of every command, in its channel's unit, (n, 3)."""
        rows = []
        for part_, _, command in self.commands:
            own = getattr(parameters.parts, part_.name)
            low, high = command.limits(own)
            rows.append((low, getattr(own, command.rest) if command.rest else command.idle, high))
        return np.array(rows, dtype=float).reshape(len(rows), 3)


def compose(parts: Sequence[Part]) -> Family:
    """The family of a hull with these parts; the same object for the same parts, in whatever order they come.

    Raises ValueError on an unknown kind, on names that are taken twice or reserved, and on channels taken twice.
    """
    ordered = sorted(parts, key=lambda part: (part.found.order, part.found.slot))
    for part_ in ordered:
        _check(part_, ordered)
    channels = [part_.channel(i) for part_, i, _ in Body(tuple(ordered)).commands]
    for name in channels:
        if channels.count(name) > 1:
            raise ValueError(f"two parts take their commands from {name}: name another channel for one of them")
    return _composed(tuple(ordered))


def _check(part_: Part, among: Sequence[Part]) -> None:
    if not part_.name.isidentifier():
        raise ValueError(
            "a part needs a name of letters, digits and underscores that does not begin with a digit, got "
            f"{part_.name!r}"
        )
    if iskeyword(part_.name):
        raise ValueError(f"a part cannot be called {part_.name!r}, which is a word of Python: choose another")
    if part_.name in RESERVED or part_.name.startswith("_"):
        raise ValueError(f"a part cannot be called {part_.name!r}, which is the name of something else: choose another")
    if sum(other.name == part_.name for other in among) > 1:
        raise ValueError(f"there are two parts of the name {part_.name!r}: choose another for one of them")


@dataclass(frozen=True)
class _Slot:
    """The parts that share compiled code: their kind, how many they are, and the index of the first's first command."""

    name: str
    kind: PartKind
    parts: tuple[Part, ...]
    first: int
    shared: int

    def meanings(self) -> dict[str, Any]:
        counts = {"COUNT": len(self.parts), "COMMANDS": max(len(self.kind.commands), 1), "FIRST": self.first}
        return {**counts, "SHARED": self.shared, "SLOT": self.name}


@lru_cache(maxsize=256)
def _composed(parts: tuple[Part, ...]) -> Family:
    body = Body(parts)
    commands = tuple(part_.channel(i) for part_, i, _ in body.commands)
    for part_, i, _ in body.commands:
        declare_input(part_.channel(i), part_.title)
    shared: dict[str, str] = {}
    for part_ in parts:
        for channel, parameter in part_.found.shared.items():
            shared.setdefault(channel, parameter and f"parts.{part_.name}.{parameter}")
    slots, first = [], 0
    for name, group in groupby(parts, key=lambda part: part.found.slot):
        members = tuple(group)
        kind = members[0].found
        at = len(commands) + list(shared).index(next(iter(kind.shared))) if kind.shared else -1
        slots.append(_Slot(name, kind, members, first, at))
        first += len(members) * len(kind.commands)
    program = "body_" + "_".join(f"{slot.name}{len(slot.parts)}" for slot in slots) if slots else "body"
    tree = _tree(parts)
    record = _record(slots)
    n_parameters, n_derived = len(list_paths(tree())), record.itemsize // 8
    view = view_as(record, program)
    inputs = (*commands, *shared)
    elapsed = inputs.index("elapsed_s") if "elapsed_s" in shared else -1
    hooks = _hooks(program, slots, record, n_parameters, n_derived, elapsed)

    def problem(parameters: Any) -> str:
        return part_problem(parts, parameters) or mass_problem(parameters, hooks.derive, record)

    first_of_kind = [slot.parts[0] for slot in slots]
    return Family(
        name="body",
        kind=body.kind,
        program=program,
        title="six degrees of freedom, a hull and its parts",
        body=body,
        parameters=tree,
        inputs=inputs,
        required=body.required(),
        constants={
            **{
                part_.channel(i): f"parts.{part_.name}.{command.rest}"
                for part_, i, command in body.commands
                if command.rest
            },
            **{channel: parameter for channel, parameter in shared.items() if parameter},
        },
        states=STATES,
        integrated=14,
        scratch=dynamics.SCRATCH,
        learns=True,
        actuators=commands,
        sensors=(*SENSORS, *(f"{name} rate" for name in commands)) if _moves(slots) else SENSORS,
        moves=_moves(slots),
        outputs=OUTPUTS,
        coefficients=(
            *(_DRAG_COEFFICIENTS if body.hovers else _HULL_COEFFICIENTS),
            *(f"parts.{part_.name}.{name}" for part_ in first_of_kind for name in part_.found.coefficients),
        ),
        main_output="heading_rad",
        nearly={f"{axis}_mps": f"{axis}_dvl_mps" for axis in "uvw"},
        at_rest=_at_rest(body.hovers),
        driven=frozenset(_HOVERING if body.hovers else ()),
        dissipating=frozenset(_DRAG_COEFFICIENTS if body.hovers else ()),
        measured={"effects.supply.sag": "supply_V"},
        twins={
            "effects.hull.damping_surge": "hull.surge.u_u",
            **{
                f"effects.{part_.name}.{effect}": f"parts.{part_.name}.{coefficient}"
                for part_ in parts
                for effect, coefficient in part_.found.twins.items()
            },
        },
        derived=n_derived,
        problem=problem,
        doubted=lambda parameters: doubted_in(parts, parameters),
        unstated=lambda parameters: unstated_drag(parameters) if body.hovers else {},
        coefficients_of=lambda parameters: coefficients_of(parts, parameters),
        doubts=lambda parameters: places_outside(parts, parameters),
        view=view,
        hooks=hooks,
        rebuild=(compose, (parts,)),
    )


def _at_rest(hovers: bool) -> dict[str, tuple[str, ...]]:
    """The states that come to rest, and what tells them: roll; of a vehicle that hovers, pitch and velocity as well."""
    roll, pitch = ("roll_rad", "p_radps"), ("pitch_rad", "q_radps")
    found: dict[str, tuple[str, ...]] = dict.fromkeys(roll, roll)
    track = ("north_m", "east_m")
    level = tuple(f"{axis}{kind}_mps" for axis in "uv" for kind in ("", "_dvl"))
    if hovers:
        found |= dict.fromkeys(pitch, pitch) | dict(
            zip(_SPEEDS, ((*level, *track), (*level, *track), ("w_mps", "w_dvl_mps", "depth_m")), strict=True)
        )
    return found


def _moves(slots: Sequence[_Slot]) -> bool:
    return any(slot.kind.block is not None for slot in slots)


def _tree(parts: tuple[Part, ...]) -> type:
    """The parameter tree: hull, parts by name, effects of the parts by name and of the body."""

    def group(name: str, members: Sequence[tuple[str, type, Any]], doc: str) -> type:
        def reduced(self: Any) -> Any:
            return _unpacked, (parts, name, pack(self).tobytes())

        space = {"__module__": __name__, "__doc__": doc, "__reduce__": reduced}
        return make_dataclass(name, members, frozen=True, namespace=space)

    own = [(p.name, p.found.parameters, part(p.found.parameters, p.title)) for p in parts]
    happening = [(p.name, p.found.effects, part(p.found.effects, p.title)) for p in parts]
    body = [
        (f.name, f.metadata["group"], part(f.metadata["group"], f.metadata["subject"]))
        for f in dataclass_fields(BodyEffects)
    ]
    named = group("Parts", own, "The parts of a vehicle by name.")
    effects = group("Effects", [*happening, *body], "The effects of the parts by name, and those of every body.")
    whole = [("hull", Hull, part(Hull)), ("parts", named, part(named)), ("effects", effects, part(effects))]
    return group("Parameters", whole, "The parameter tree of a vehicle in six degrees of freedom.")


def _unpacked(parts: tuple[Part, ...], name: str, numbers: bytes) -> Any:
    """What pickle makes of a tree of a composed vehicle."""
    tree = _composed(parts).parameters()
    made = {"Parts": tree.parts, "Effects": tree.effects, "Parameters": tree}[name]
    values = iter(np.frombuffer(numbers))

    def filled(node: Any) -> Any:
        given = {
            f.name: next(values) if "spec" in f.metadata else filled(getattr(node, f.name))
            for f in dataclass_fields(node)
        }
        return type(node)(**{name: float(v) if isinstance(v, np.floating) else v for name, v in given.items()})

    return filled(made)


def _record(slots: Sequence[_Slot]) -> np.dtype:
    """The record that compiled code sees: the tree with the parts of a kind as an array, then what is derived."""

    def arrays(group: Callable[[PartKind], np.dtype]) -> np.dtype:
        return _record_of([(slot.name, group(slot.kind), (len(slot.parts),)) for slot in slots])

    body = record_type(BodyEffects)
    shared = [(name, body[name]) for name in body.names or ()]
    effects = [("parts", arrays(lambda kind: record_type(kind.effects))), *shared]
    return _record_of(
        [
            ("hull", record_type(Hull)),
            ("parts", arrays(lambda kind: record_type(kind.parameters))),
            ("effects", _record_of(effects)),
            ("computed", derived_numbers.COMPUTED),
            ("derived", arrays(lambda kind: _record_of([(n, np.float64) for n in (*kind.numbers, "unused")]))),
        ]
    )


def _record_of(fields: Sequence[tuple]) -> np.dtype:
    return np.dtype((np.record, [*fields]))


def _hooks(
    program: str, slots: Sequence[_Slot], record: np.dtype, n_parameters: int, n_derived: int, elapsed: int
) -> RightHandSide:
    """The compiled functions of the family."""

    def chain(
        nothing: Any,
        of_kind: Any,
        then: Any,
        function: str,
        among: Sequence[_Slot],
        more: Mapping[str, Any] | None = None,
    ) -> Any:
        linked = nothing
        for slot in among:
            given = getattr(slot.kind, function)
            if given is None:
                continue
            name = f"{program}_{slot.name}"
            own = bind(of_kind, name, **slot.meanings(), **(more or {}), **{f"part_{function}": given})
            linked = bind(then, name, before=linked, own=own, FIRST=slot.first)
        return linked

    moved = [slot for slot in slots if slot.kind.commands]
    with_hull = [slot for slot in slots if slot.kind.with_hull]
    others = [slot for slot in slots if not slot.kind.with_hull]
    moves, actuators = _moves(slots), sum(len(slot.parts) * len(slot.kind.commands) for slot in slots)
    carried: dict[str, Any] = {"ACTUATORS": actuators, "RATES_AT": len(SENSORS)}
    loads = chain(blocks.no_load, blocks.load_blocks_of_kind, blocks.load_blocks_then, "block", slots, carried)
    wakes = chain(sums.no_wakes, sums.wakes_of_kind, sums.wakes_then, "wake", slots)
    in_wake = chain(sums.nothing_in_wakes, sums.in_wake_of_kind, sums.in_wake_then, "in_wake", slots)
    forces = (sums.no_forces, sums.forces_of_kind, sums.forces_then, "force")
    derivative = bind(
        dynamics.derivative,
        program,
        ELAPSED=elapsed,
        forces_with_hull=chain(*forces, with_hull),
        forces_of_drives=chain(*forces, others),
        # a call, so that the usual step is short
        forces_in_wakes=bind(sums.wake_forces, program, inline=False, wakes=wakes, in_wake=in_wake),
        accelerate=bind(blocks.accelerate_by_elimination, program, load_blocks=loads)
        if moves
        else dynamics.accelerate_by_inverse,
    )
    derive = bind(
        derived_numbers.derive,
        program,
        inline=False,
        N_PARAMETERS=n_parameters,
        N_DERIVED=n_derived,
        ACTUATORS=actuators,
        wakes=wakes,
        writable_view=view_as(record, program, writable=True),
        derive_parts=chain(sums.nothing_derived, sums.derive_kind, sums.derive_then, "derive", slots),
        damp_by_parts=chain(sums.nothing_derived, sums.damping_of_kind, sums.derive_then, "damping", slots),
    )
    kick = no_kick
    if moves:
        exchanged = chain(blocks.no_exchange, blocks.exchange_of_kind, blocks.exchange_then, "block", slots, carried)
        kick = bind(blocks.kick, program, exchange_blocks=exchanged, **carried)
    return RightHandSide(
        derivative=derivative,
        stable_step=dynamics.stable_step,
        shape=chain(sums.no_shapes, sums.shape_of_kind, sums.shape_then, "shape", moved),
        actuator_times=chain(sums.no_actuator, sums.times_of_kind, sums.times_then, "times", moved),
        sense=sense,
        settle_sensors=settle_sensors,
        output=output,
        enter=dynamics.enter,
        leave=dynamics.leave,
        derive=bind(derived_numbers.hand_on, program, inline=False, derive=derive),
        kick=kick,
    )


def mass_problem(parameters: Any, derive: Callable[..., Any], record: np.dtype) -> str:
    """What is wrong with the mass matrix, or nothing: its symmetric part must be positive definite."""
    numbers = np.zeros(record.itemsize // 8)
    derive(pack(parameters), numbers)
    computed = numbers.view(record)[0].computed
    rigid, whole = computed.rigid_mass, computed.mass
    for name, matrix in (
        ("mass matrix of the rigid body", rigid),
        ("mass matrix with added mass", 0.5 * (whole + whole.T)),
    ):
        values, vectors = np.linalg.eigh(matrix)
        if values[0] <= 0.0:
            axis = _AXES[int(np.argmax(np.abs(vectors[:, 0])))]
            return (
                f"the {name} is not positive definite (smallest eigenvalue {values[0]:.3g}, mostly in {axis}): "
                "check hull.mass, the inertias, the centre of gravity and hull.added_mass (negative there)"
            )
    return ""


def places_outside(parts: Sequence[Part], parameters: Any) -> list[str]:
    """Words about parts that sit farther outside the hull than it is long, which a wrong unit makes them."""
    length, radius = parameters.hull.length, 0.5 * parameters.hull.diameter
    found = []
    for part_ in parts:
        for key in part_.found.place:
            place = getattr(getattr(parameters.parts, part_.name), key)
            farthest = length + (0.5 * length if key.endswith("x") else radius)
            if abs(place) > farthest:
                found.append(
                    f"parts.{part_.name}.{key} = {place:g} m is more than a length outside the hull, which is "
                    f"{length:g} m long: check its unit and sign"
                )
    return found


def doubted_in(parts: Sequence[Part], parameters: Any) -> list[str]:
    """The paths of all hydrodynamic coefficients and inertias that are not zero: what tables are off by."""
    hull = [f"hull.{path}" for path in list_paths(parameters.hull) if path.startswith(_DOUBTED)]
    own = [f"parts.{part_.name}.{name}" for part_ in parts for name in part_.found.doubted]
    return [path for path in (*hull, *own) if value_at(parameters, path) != 0.0]


def unstated_drag(parameters: Any) -> dict[str, float]:
    """The standard deviation, by path, of each drag coefficient that is zero, of a vehicle that hovers.

    So much that an axis comes to rest within a second, mass and added mass over 1 s, or from 0.3 m/s or rad/s with the
    square: as fast as such vehicles do.  Without it, a fit would take any drag for an axis that no sensor measures.
    """
    hull, added = parameters.hull, parameters.hull.added_mass
    masses = (
        *(hull.mass - added.x_udot, hull.mass - added.y_vdot, hull.mass - added.z_wdot),
        *(hull.i_xx - added.k_pdot, hull.i_yy - added.m_qdot, hull.i_zz - added.n_rdot),
    )
    found = {}
    for linear, square, mass in zip(_DRAG_COEFFICIENTS[::2], _DRAG_COEFFICIENTS[1::2], masses, strict=True):
        found |= {linear: mass / _STOPS_IN_S, square: mass / _STOPS_IN_S / _STOPS_FROM}
    return {path: deviation for path, deviation in found.items() if value_at(parameters, path) == 0.0}


def coefficients_of(parts: Sequence[Part], parameters: Any) -> dict[str, tuple[str, Callable[[float, float], float]]]:
    """The effects that do nothing but change one coefficient of a vehicle with these parameters; see `Family`."""

    def scaled(given: float, size: float) -> float:
        return given * (1.0 + size)

    hull = parameters.hull
    found: dict[str, tuple[str, Callable[[float, float], float]]] = {
        f"effects.hull.added_mass_{axis}": (f"hull.added_mass.{name}", scaled)
        for axis, name in zip(_AXES, ("x_udot", "y_vdot", "z_wdot", "k_pdot", "m_qdot", "n_rdot"), strict=True)
    }
    crossed = hull.cross_flow.drag_y != 0.0 or hull.cross_flow.drag_z != 0.0
    for axis in _AXES:
        terms = getattr(hull, axis)
        acting = [term for term in derived_numbers.DAMPING_TERMS if getattr(terms, term) != 0.0]
        if len(acting) == 1 and not (crossed and axis in ("sway", "heave")):
            found[f"effects.hull.damping_{axis}"] = (f"hull.{axis}.{acting[0]}", scaled)
    for part_ in parts:
        for effect, (name, law) in part_.found.same.items():
            found[f"effects.{part_.name}.{effect}"] = (f"parts.{part_.name}.{name}", law)
    return found


def part_problem(parts: Sequence[Part], parameters: Any) -> str:
    """What is impossible about the numbers of a part, or nothing."""
    for part_ in parts:
        own, kind = getattr(parameters.parts, part_.name), part_.found
        found = kind.problem(own) or kind.problem_with_hull(own, parameters.hull)
        if found:
            return f"parts.{part_.name}{found}".replace("{}", f"parts.{part_.name}")
    return ""
