"""The family of a vehicle in six degrees of freedom: a hull and the parts named in its file.

Parts of one kind are adjacent in the parameters, so that compiled code sees an array of records; their number is a
constant of that code. Code that depends on the kinds is bound pairwise, as a chain with a link for each kind, and
cached by the counts: vehicles with the same numbers of parts of each kind share their code.
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
from auv_gym.param import list_paths, pack, part, record_type
from auv_gym.vehicles.body import blocks, derived as derived_numbers, dynamics, sums
from auv_gym.vehicles.body.body import Body, Part
from auv_gym.vehicles.body.coefficients import (
    DRAG_COEFFICIENTS,
    HULL_COEFFICIENTS,
    coefficients_of,
    doubted_in,
    mass_problem,
    part_problem,
    places_outside,
    unstated_drag,
)
from auv_gym.vehicles.body.hull import Hull
from auv_gym.vehicles.body.kinds import PartKind
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
_HOVERING = (*_SPEEDS, "p_radps", "q_radps", "roll_rad", "pitch_rad")  # states that commands move from rest


def compose(parts: Sequence[Part]) -> Family:
    """The family of a hull with these parts; the same object for the same parts, in any order.

    Raises ValueError for an unknown kind, for duplicate or reserved names, and for duplicate channels.
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
    """The parts that share compiled code: their kind, their number, and the index of the first one's first command."""

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
    for part_, i, command in body.commands:
        several = len(part_.found.commands) > 1
        declare_input(part_.channel(i), f"{command.quantity} of the {part_.title}" if several else part_.title)
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
            *(DRAG_COEFFICIENTS if body.hovers else HULL_COEFFICIENTS),
            *(f"parts.{part_.name}.{name}" for part_ in first_of_kind for name in part_.found.coefficients),
        ),
        main_output="heading_rad",
        nearly={f"{axis}_mps": f"{axis}_dvl_mps" for axis in "uvw"},
        at_rest=_at_rest(body.hovers),
        driven=frozenset(_HOVERING if body.hovers else ()),
        dissipating=frozenset(DRAG_COEFFICIENTS if body.hovers else ()),
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
    """The states that come to rest, and the channels that show them: roll; for hovering, also pitch and velocity."""
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
    """The parameter tree: hull, parts by name, effects of the parts by name, and effects of the body."""

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
    """Unpickle the parameter tree of a composed vehicle."""
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
    """The record for compiled code: the tree with an array of the parts of each kind, then the derived numbers."""

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
        # a function call, so that the usual step stays short
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
