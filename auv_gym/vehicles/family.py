"""What a vehicle family is: a parameter tree and the compiled functions that the rollout is bound to."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from auv_gym.compiled import compiled


def _no_problem(parameters: Any) -> str:
    return ""


def _no_coefficients(parameters: Any) -> Mapping[str, tuple[str, Callable[[float, float], float]]]:
    return {}


def _none_doubted(parameters: Any) -> Sequence[str]:
    return ()


def _none_unstated(parameters: Any) -> Mapping[str, float]:
    return {}


def _no_doubts(parameters: Any) -> list[str]:
    return []


def _none_beyond(time: Any, columns: Mapping[str, Any]) -> Mapping[str, Any]:
    return {}


@compiled
def no_kick(z, sensors, path, h, p, scratch):
    """The jump of velocity of a vehicle in which no mass moves."""
    return


@dataclass(frozen=True, eq=False)
class RightHandSide:
    """The compiled functions of a family; p: what `derive` makes of the parameters, through the family's view.

    x: the states, as they are between samples, and z: those of RK4.  actuators: their positions.
    """

    # (z, actuators, inputs, p, dz, scratch): the slopes of z into dz
    derivative: Callable[[Any, Any, Any, Any, Any, Any], None]
    # (z, inputs, p): the longest step of RK4, s
    stable_step: Callable[[Any, Any, Any], float]
    # (inputs, memory, p, shaped): commands after their effects that take no time, into shaped; memory is updated
    shape: Callable[[Any, Any, Any, Any], None]
    # (index, p): dead time s, lag s and slowness, s per unit, of an actuator
    actuator_times: Callable[[int, Any], tuple[float, float, float]]
    # (before, z, sensors, duration, p): update the sensors' states after a step
    sense: Callable[[Any, Any, Any, float, Any], None]
    # (x, actuators, sensors, p): the sensors' states after a long time at the present rates
    settle_sensors: Callable[[Any, Any, Any, Any], None]
    # (x, actuators, sensors, p, y): the outputs into y
    output: Callable[[Any, Any, Any, Any, Any], None]
    # (x, z) and (z, x): from the states to the integrated ones, and back
    enter: Callable[[Any, Any], None]
    leave: Callable[[Any, Any], None]
    # (vector, derived): what follows from the parameters alone
    derive: Callable[[Any, Any], None]
    # (z, sensors, path, h, p, scratch): put the actuators' rates into path, and let momentum pass from masses that move
    kick: Callable[[Any, Any, Any, float, Any, Any], None] = no_kick


@dataclass(frozen=True, eq=False)
class Family:
    """A right-hand side with its channels, and what else sets one family apart from another."""

    name: str
    kind: str
    title: str
    parameters: type
    inputs: tuple[str, ...]
    required: tuple[str, ...]  # inputs that a record must have
    states: tuple[str, ...]  # kept between samples
    integrated: int  # number of states of RK4
    actuators: tuple[str, ...]  # one per commanded input; these come first in `inputs`, in the same order
    sensors: tuple[str, ...]
    outputs: tuple[str, ...]
    coefficients: tuple[str, ...]  # paths that a first fit frees
    derived: int  # length of what `derive` makes, without a table
    view: Callable[..., Any]
    hooks: RightHandSide
    scratch: int = 0  # length of the last argument of `derivative`
    learns: bool = False  # whether a table of learned forces may follow the parameters
    block: int = 1_000_000  # steps after which `stable_step` is asked again
    problem: Callable[[Any], str] = _no_problem  # words about impossible parameters, or nothing
    doubts: Callable[[Any], list[str]] = _no_doubts  # words about parameters that are possible, but hardly meant
    # steps of difference quotients, of a parameter's scale: larger than the rounding of kinks, smaller than a probe; a
    # fit that has come to rest goes on with the next one, for runs that are far from linear in the parameters
    differences: tuple[float, ...] = (1e-2,)
    # where an input that is not required comes from: the parameter at a path; otherwise zero
    constants: Mapping[str, str] = field(default_factory=dict)
    # of these parameters, the paths of further coefficients that are known no better than those a first fit frees
    doubted: Callable[[Any], Sequence[str]] = _none_doubted
    # of these parameters, the standard deviation, by path, of coefficients that are zero as nobody stated them; the
    # other ones that are zero are no part of the model
    unstated: Callable[[Any], Mapping[str, float]] = _none_unstated
    # effects that act as a coefficient does
    twins: Mapping[str, str] = field(default_factory=dict)
    # of these parameters, the effects that do nothing but change one coefficient: its path, and its value from the
    # given one and the effect's size
    coefficients_of: Callable[[Any], Mapping[str, tuple[str, Callable[[float, float], float]]]] = _no_coefficients
    # states that do not change in a segment and whose value nobody knows, each with the effect that acts as it does;
    # none where the parameter at `shared_unless` is not zero
    shared: Mapping[str, str] = field(default_factory=dict)
    shared_unless: str = ""
    # effects that may have another size in each dive of a log, where the evidence asks for it
    by_dive: tuple[str, ...] = ()
    # inputs that change now and then, so that free runs lie between
    stepped: tuple[str, ...] = ()
    # depth, m, above which it may bob or bounce at the surface, which no fit of a free run's start can follow
    afloat: float | None = None
    # effects that are nothing to look for where a record has the channel
    measured: Mapping[str, str] = field(default_factory=dict)
    # lowest and highest that a record's channel can be, as numbers or paths of parameters
    ranges: Mapping[str, tuple[float | str, float | str]] = field(default_factory=dict)
    # outputs that tell a state nearly, for its first value where its own reading is missing
    nearly: Mapping[str, str] = field(default_factory=dict)
    # states that come to rest near 0 by themselves, and the channels that tell them: without any, fits leave their
    # starts there, since starts that only their couplings reveal take up whatever a model lacks
    at_rest: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    # of these, those that commands move: they follow the vehicle's model, from rest where a segment of a log begins
    driven: frozenset[str] = frozenset()

    # whether internal waves, of minutes, carry it up and down
    carried: bool = False

    # coefficients that only take energy: those that are negative stay so in fits, or runs would drive themselves
    dissipating: frozenset[str] = frozenset()

    # inputs that go on evenly from one sample of a log to the next: over an interval, their mean counts
    interpolated: tuple[str, ...] = ()
    # inputs that a log should measure: where it does not, it is said which value is assumed
    assumed: tuple[str, ...] = ()
    # samples of a log that the family does not describe: of times and channels of a segment, masks by what they are
    beyond: Callable[[Any, Mapping[str, Any]], Mapping[str, Any]] = _none_beyond
    # of these parameters and what a log states, the values by path that take the place of the vehicle's own; none where
    # no log states any
    stated: Callable[[Any, Mapping[str, Any]], Mapping[str, float]] | None = None

    # an output without which nothing can be learned from a log; the first one by default
    main_output: str = ""
    # masses move in the vehicle: the derivative sees the actuators' rates behind their positions, as `kick` puts them
    moves: bool = False
    program: str = ""  # families of one program share their compiled code; by default those of one kind
    body: Any = None  # of a hull and its parts, what is known of these: `vehicles.body.body.Body`
    rebuild: tuple[Callable[..., Any], tuple[Any, ...]] | None = None  # of families that have no name of their own

    @property
    def leading(self) -> str:
        """The output that a log must have."""
        return self.main_output or self.outputs[0]

    def resting(self, channels: Collection[str]) -> set[str]:
        """The states whose starts no fit of free runs moves, since none of these channels tells them."""
        return {state for state, telling in self.at_rest.items() if not any(name in channels for name in telling)}

    def __reduce__(self):
        return self.rebuild or (_named, (self.name,))


def _named(name: str) -> Family:
    """The one family of this name: a copy or pickle of a plant has the same as the plant."""
    return FAMILIES[name]


FAMILIES: dict[str, Family] = {}  # reduced families by name; that of a body is made of its parts


def registered(family: Family) -> Family:
    """The family, found by its name from now on; raises ValueError where there is another of this name."""
    if FAMILIES.setdefault(family.name, family) is not family:
        raise ValueError(f"There is a family {family.name!r} already: choose another name.")
    return family


@compiled
def copied(source, target):
    """The entries of source in target: `enter`, `leave` and `derive` of a family that needs no other form."""
    for i in range(min(source.shape[0], target.shape[0])):
        target[i] = source[i]
