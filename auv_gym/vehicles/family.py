"""Vehicle families: a parameter tree and the compiled functions that the rollout is bound to."""

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
    """No jump of velocity, for a vehicle without moving masses."""
    return


@dataclass(frozen=True, eq=False)
class RightHandSide:
    """The compiled functions of a family; p: the result of `derive`, through the family's view.

    x: the states, as kept between samples, and z: the integrated ones.  actuators: their positions.
    """

    # (z, actuators, inputs, p, dz, scratch): write the derivatives of z into dz
    derivative: Callable[[Any, Any, Any, Any, Any, Any], None]
    # (z, inputs, p): the longest step of RK4, s
    stable_step: Callable[[Any, Any, Any], float]
    # (inputs, memory, p, shaped): write commands after their instantaneous effects into shaped; updates memory
    shape: Callable[[Any, Any, Any, Any], None]
    # (index, p): dead time s, lag s and slowness, s per unit, of an actuator
    actuator_times: Callable[[int, Any], tuple[float, float, float]]
    # (before, z, sensors, duration, p): update the sensors' states after a step
    sense: Callable[[Any, Any, Any, float, Any], None]
    # (x, actuators, sensors, p): set the sensors' states as after a long time at the present rates
    settle_sensors: Callable[[Any, Any, Any, Any], None]
    # (x, actuators, sensors, p, y): write the outputs into y
    output: Callable[[Any, Any, Any, Any, Any], None]
    # (x, z) and (z, x): convert the states to the integrated ones, and back
    enter: Callable[[Any, Any], None]
    leave: Callable[[Any, Any], None]
    # (vector, derived): compute what depends on the parameters alone
    derive: Callable[[Any, Any], None]
    # (z, sensors, path, h, p, scratch): put the actuators' rates into path, and exchange momentum with moving masses
    kick: Callable[[Any, Any, Any, float, Any, Any], None] = no_kick


@dataclass(frozen=True, eq=False, repr=False)
class Family:
    """A right-hand side with its channels, and all other properties of a family."""

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
    derived: int  # length of the result of `derive`, without a table
    view: Callable[..., Any]
    hooks: RightHandSide
    scratch: int = 0  # length of the last argument of `derivative`
    learns: bool = False  # whether a table of learned forces may follow the parameters
    block: int = 1_000_000  # steps after which `stable_step` is evaluated again
    problem: Callable[[Any], str] = _no_problem  # words about impossible parameters, or nothing
    doubts: Callable[[Any], list[str]] = _no_doubts  # warnings about possible, but unlikely parameters
    # steps of difference quotients, in a parameter's scale: larger than the rounding of kinks, smaller than a probe; a
    # converged fit continues with the next one, for runs that are strongly nonlinear in the parameters
    differences: tuple[float, ...] = (1e-2,)
    # source of an input that is not required: the parameter at a path; otherwise zero
    constants: Mapping[str, str] = field(default_factory=dict)
    # function from the parameters to the paths of further coefficients as uncertain as those that a first fit frees
    doubted: Callable[[Any], Sequence[str]] = _none_doubted
    # function from the parameters to the standard deviation, by path, of coefficients that are zero because nobody
    # stated them; others that are zero are not part of the model
    unstated: Callable[[Any], Mapping[str, float]] = _none_unstated
    # effects that are equivalent to a coefficient
    twins: Mapping[str, str] = field(default_factory=dict)
    # function from the parameters to the effects that only change one coefficient: its path, and its value as a
    # function of the given value and the effect's size
    coefficients_of: Callable[[Any], Mapping[str, tuple[str, Callable[[float, float], float]]]] = _no_coefficients
    # unknown states that are constant in a segment, each with the effect that it is equivalent to; none if the
    # parameter at `shared_unless` is not zero
    shared: Mapping[str, str] = field(default_factory=dict)
    shared_unless: str = ""
    # effects that add up over the time since the log began, each with the one that equals what has added up
    adding: Mapping[str, str] = field(default_factory=dict)
    # effects whose size may differ between the dives of a log, if the evidence requires it
    by_dive: tuple[str, ...] = ()
    # inputs that change occasionally; free runs go from one change to the next
    stepped: tuple[str, ...] = ()
    # depth, m, above which it may bob at the surface, which no fit of a free run's start can follow
    afloat: float | None = None
    # effects that are not searched for if a record has the channel
    measured: Mapping[str, str] = field(default_factory=dict)
    # lowest and highest value of a record's channel, as numbers or paths of parameters
    ranges: Mapping[str, tuple[float | str, float | str]] = field(default_factory=dict)
    # outputs that nearly give a state, for its first value if its own reading is missing
    nearly: Mapping[str, str] = field(default_factory=dict)
    # states that come to rest near 0 by themselves, and the channels that show them: without any, fits leave their
    # starts there, since starts that are only visible through couplings would absorb model errors
    at_rest: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    # those of them that commands move: they follow the vehicle's model, from rest where a segment of a log begins
    driven: frozenset[str] = frozenset()

    # whether internal waves, with periods of minutes, carry it up and down
    carried: bool = False
    # positions that water which moves at random changes, beside the velocities
    drifting: tuple[str, ...] = ("north_m", "east_m")

    # coefficients that only dissipate energy: if negative, they stay so in fits; otherwise runs would drive themselves
    dissipating: frozenset[str] = frozenset()

    # inputs that vary smoothly between the samples of a log: their mean over an interval is used
    interpolated: tuple[str, ...] = ()
    # inputs that a log should measure; if it does not, the assumed value is reported
    assumed: tuple[str, ...] = ()
    # function from times and channels of a segment to masks, by reason, of samples that the family does not describe
    beyond: Callable[[Any, Mapping[str, Any]], Mapping[str, Any]] = _none_beyond
    # function from the parameters and a log's attributes to values by path that replace the vehicle's own; None if no
    # log states any
    stated: Callable[[Any, Mapping[str, Any]], Mapping[str, float]] | None = None

    # an output that is necessary for learning anything from a log; default: the first one
    main_output: str = ""
    # whether masses move in the vehicle: the derivative then sees the actuators' rates after their positions, see
    # `kick`
    moves: bool = False
    program: str = ""  # families with the same program share compiled code; default: those of one kind
    body: Any = None  # for a hull with parts, their description: `vehicles.body.body.Body`
    rebuild: tuple[Callable[..., Any], tuple[Any, ...]] | None = None  # for families without a name of their own

    def __repr__(self) -> str:
        return f"Family({self.name!r}: {self.title})"

    @property
    def leading(self) -> str:
        """The output that a log must have."""
        return self.main_output or self.outputs[0]

    def resting(self, channels: Collection[str]) -> set[str]:
        """The states whose starts fits of free runs do not move, since none of these channels shows them."""
        return {state for state, telling in self.at_rest.items() if not any(name in channels for name in telling)}

    def __reduce__(self):
        return self.rebuild or (_named, (self.name,))


def _named(name: str) -> Family:
    """The family of this name; unpickling returns the same object."""
    return FAMILIES[name]


FAMILIES: dict[str, Family] = {}  # reduced families by name; a body's family is composed of its parts


def registered(family: Family) -> Family:
    """Register a family by its name and return it; raises ValueError if the name is taken."""
    if FAMILIES.setdefault(family.name, family) is not family:
        raise ValueError(f"There is a family {family.name!r} already: choose another name.")
    return family


@compiled
def copied(source, target):
    """Copy source to target: `enter`, `leave` and `derive` of a family that needs no other form."""
    for i in range(min(source.shape[0], target.shape[0])):
        target[i] = source[i]
