"""The tasks of the environments as data: targets, observations, reward, envelope.

Sizes are in units of the vehicle, so that they fit vehicles of any size: a length, a speed, and their quotient, a rate
in 1/s.  For a torpedo these are its length and cruise speed (see `plant.cruise`).  For a float they are its speed at
full travel and the distance that it covers in its own time scale (see `plant.float_engine`).  A glider has its nominal
speed and its steady turn at full rudder, and its times are in s.  A vehicle moved by thrusters has its length, and its
attainable speed and rate of turn.  A flying glider, and one in six degrees of freedom moved by volume and masses, has
its horizontal speed at a usual pitch with full engine volume, and the distance that it covers in a yo, down to the
bottom and back up.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, radians
from typing import Any, Literal

Unit = Literal["", "length", "speed", "rate", "turn", "deepest"]

PROPULSION = "propulsion"  # represents the vehicle's own channel: propeller_rpm, propeller_V or speed_cmd_mps
ENGINE = "engine"  # likewise: piston_m or oil_volume_m3


@dataclass(frozen=True)
class Observed:
    """One number of an observation: (source - offset) / scale, clipped to [-1, 1].

    source: a reading's channel, an input channel for its last command over its limit, or a name in `Layout.geometry`.
    offset, scale: in the vehicle's `unit`.
    """

    name: str
    source: str
    scale: float = 1.0
    unit: Unit = ""
    offset: float = 0.0


@dataclass(frozen=True)
class Task:
    """A task of an environment.

    channel: the channel that has a target; empty for a path.  actions: inputs that the agent commands, if the vehicle
    has them; a regulator holds the cruise with other fins.  step, hold, band: of a drawn target, its change in `unit`s,
    its duration in lengths travelled, and its range.  scale: error with the largest cost.  weights: of the reward
    terms, by name, in the order of `layout.TERMS`.  duration: default of an episode, s, for a float in lengths
    travelled.  current: largest drawn one, in cruise speeds, if nothing else is randomised.  vehicle: the default; the
    task is for vehicles of its kind.  targets: the channels of a target with several.
    forms: the task for other kinds of vehicle.
    """

    name: str
    actions: tuple[str, ...]
    observed: tuple[Observed, ...]
    weights: dict[str, float]
    channel: str = ""
    unit: Unit = ""
    scale: float = 1.0
    step: tuple[float, float] = (0.0, 0.0)
    hold: tuple[float, float] = (15.0, 35.0)
    band: tuple[float, float] = (-1e9, 1e9)
    duration: float = 60.0
    current: float = 0.0
    vehicle: str = "remus100"
    targets: tuple[str, ...] = ()
    forms: tuple[Task, ...] = ()


COMMAND_TRAVEL = 0.05  # weight of the change of the commands

START_DEPTH = (10.0, 20.0)  # lengths
DEPTHS = (5.0, 25.0)  # lengths; range of targets

# Envelope: far outside of what a controlled vehicle does.
DEPTH_LIMIT = 50.0  # lengths
PITCH_LIMIT = radians(80.0)
ROLL_LIMIT = radians(120.0)
SPEED_LIMIT = 4.0  # cruise speeds
RATE_LIMIT = 10.0  # cruise speed over length

HELD_PITCH = 0.35  # rad; pitch at which the held stern plane returns to its depth

# Paths
LEG = (15.0, 30.0)  # lengths
TURN = radians(75.0)  # largest change of course at a waypoint
SLOPE = 0.25  # rad, steepest drawn leg
PATH_SPEED = 0.8  # cruise speeds along the leg, over ground
RADIUS = 2.0  # lengths; a waypoint nearer than this is reached


def legs_and_limits(length: float, speed: float, rate: float, along: float) -> dict[str, Any]:
    """The fields of a plan for starts, legs and the envelope of a vehicle in six degrees of freedom, in SI.

    length, m, speed, m/s, and rate, rad/s, are the vehicle's scales; along: share of its speed along a leg.
    """
    return {
        "start_depth": [k * length for k in START_DEPTH],
        "leg": [k * length for k in LEG],
        "turn": TURN,
        "slope": SLOPE,
        "path_speed": along * speed,
        "radius": RADIUS * length,
        "depth_limit": DEPTH_LIMIT * length,
        "pitch_limit": PITCH_LIMIT,
        "roll_limit": ROLL_LIMIT,
        "speed_limit": SPEED_LIMIT * speed,
        "rate_limit": RATE_LIMIT * rate,
    }


HEADINGS = (-2.0 * pi, 2.0 * pi)  # rad, of given targets: either way round, and no degrees


def target_limits(length: float, speed: float) -> dict[str, tuple[float, float]]:
    """The range of targets, by channel, within the envelope of a vehicle of a length, m, and a speed, m/s; SI."""
    return {
        "depth_m": (0.0, DEPTH_LIMIT * length),
        "heading_rad": HEADINGS,
        "pitch_rad": (-PITCH_LIMIT, PITCH_LIMIT),
        "roll_rad": (-ROLL_LIMIT, ROLL_LIMIT),
        "u_mps": (0.0, SPEED_LIMIT * speed),
    }


def start_limits(depth: float, speed: float, rate: float) -> dict[str, tuple[float, float]]:
    """The range of initial values, by channel, within the envelope of a vehicle in six degrees of freedom; SI.

    depth: m, the largest.  speed, m/s, and rate, rad/s, are the vehicle's scales.
    """
    fastest, quickest = SPEED_LIMIT * speed, RATE_LIMIT * rate
    return {
        "depth_m": (0.0, depth),
        "pitch_rad": (-PITCH_LIMIT, PITCH_LIMIT),
        "roll_rad": (-ROLL_LIMIT, ROLL_LIMIT),
        **dict.fromkeys(("u_mps", "v_mps", "w_mps"), (-fastest, fastest)),
        **dict.fromkeys(("p_radps", "q_radps", "r_radps"), (-quickest, quickest)),
    }


_SURGE = Observed("speed", "u_mps", 1.0, "speed", offset=1.0)
_ROLL = Observed("roll", "roll_rad", pi / 2)
_PITCH = Observed("pitch", "pitch_rad", pi / 2)
_PITCH_RATE = Observed("pitch_rate", "q_radps", 1.0, "rate")
_YAW_RATE = Observed("yaw_rate", "r_radps", 1.0, "rate")
_SWAY = Observed("sway", "v_mps", 0.5, "speed")
_HEAVE = Observed("heave", "w_mps", 0.5, "speed")

DEPTH = Task(
    name="Depth",
    channel="depth_m",
    unit="length",
    scale=5.0,
    step=(1.0, 4.0),
    band=DEPTHS,
    actions=("stern_plane_rad", "bow_plane_rad"),
    observed=(
        Observed("depth_error", "error", 5.0, "length"),
        _PITCH,
        _PITCH_RATE,
        _HEAVE,
        _SURGE,
        Observed("stern_plane", "stern_plane_rad"),
        Observed("bow_plane", "bow_plane_rad"),
    ),
    weights={"depth": 1.0, "command_travel": COMMAND_TRAVEL},
)

HEADING = Task(
    name="Heading",
    channel="heading_rad",
    scale=pi,
    step=(radians(20.0), radians(70.0)),
    actions=("rudder_rad",),
    observed=(
        Observed("heading_error_sin", "error_sin"),
        Observed("heading_error_cos", "error_cos"),
        _YAW_RATE,
        _SWAY,
        _ROLL,
        _SURGE,
        Observed("rudder", "rudder_rad"),
    ),
    weights={"heading": 1.0, "command_travel": COMMAND_TRAVEL},
)

SPEED = Task(
    name="Speed",
    channel="u_mps",
    unit="speed",
    scale=1.0,
    step=(0.1, 0.4),
    band=(0.5, 1.0),
    actions=(PROPULSION,),
    observed=(
        Observed("speed_error", "error", 1.0, "speed"),
        _SURGE,
        _PITCH,
        Observed("propulsion", PROPULSION),
    ),
    weights={"speed": 1.0, "command_travel": COMMAND_TRAVEL},
)

# Vehicles moved by thrusters
POSE = ("north_m", "east_m", "depth_m", "heading_rad", "roll_rad", "pitch_rad")
THRUST_PATH_SPEED = 0.5  # attainable speeds along the leg, over ground: leaves thrust for a current and for turning
ATTITUDE_SCALE = pi  # rad, error with the largest cost
SUM_LIMIT = 25.0  # of the sums of errors, each in lengths or radians and at most 1, over the time to travel a length

_OVER_GROUND = (
    Observed("speed_ground", "u_dvl_mps", 1.0, "speed"),
    Observed("sway_ground", "v_dvl_mps", 1.0, "speed"),
    Observed("heave_ground", "w_dvl_mps", 1.0, "speed"),
)
_RATES = (
    Observed("roll_rate", "p_radps", 1.0, "turn"),
    Observed("pitch_rate", "q_radps", 1.0, "turn"),
    Observed("yaw_rate", "r_radps", 1.0, "turn"),
)
_OFF = (
    Observed("ahead", "error_ahead", 5.0, "length"),
    Observed("starboard", "error_starboard", 5.0, "length"),
    Observed("below", "error_below", 5.0, "length"),
    Observed("heading_error_sin", "heading_error_sin"),
    Observed("heading_error_cos", "heading_error_cos"),
)
_SUMS = tuple(Observed(name, name, SUM_LIMIT) for name in ("sum_ahead", "sum_starboard", "sum_below", "sum_heading"))

STATION_KEEPING = Task(
    name="StationKeeping",
    vehicle="bluerov2_heavy",
    unit="length",
    scale=2.0,
    targets=POSE,
    actions=(),
    observed=(*_OFF, _ROLL, _PITCH, *_OVER_GROUND, *_RATES, *_SUMS),
    weights={"position": 0.6, "command_travel": COMMAND_TRAVEL, "attitude": 0.4},
    duration=60.0,
    current=0.3,
)

POSE_TASK = Task(
    name="Pose",
    vehicle="bluerov2_heavy",
    unit="length",
    scale=5.0,
    step=(2.0, 8.0),
    hold=(60.0, 120.0),
    band=DEPTHS,
    targets=POSE,
    actions=(),
    observed=(
        *_OFF,
        Observed("roll_error", "roll_error", pi / 2),
        Observed("pitch_error", "pitch_error", pi / 2),
        _ROLL,
        _PITCH,
        *_OVER_GROUND,
        *_RATES,
        *_SUMS,
    ),
    weights={"position": 0.6, "command_travel": COMMAND_TRAVEL, "attitude": 0.4},
    duration=180.0,
    current=0.15,
)

_LEG = (
    Observed("across", "across", 5.0, "length"),
    Observed("below", "below", 5.0, "length"),
    Observed("remaining", "remaining", LEG[1], "length"),
    Observed("course_error_sin", "course_sin"),
    Observed("course_error_cos", "course_cos"),
    Observed("descent", "sink", pi / 2),
    Observed("next_course_error_sin", "next_course_sin"),
    Observed("next_course_error_cos", "next_course_cos"),
    Observed("next_descent", "next_sink", pi / 2),
)

THRUST_PATH = Task(
    name="Path",
    vehicle="bluerov2",
    unit="length",
    scale=5.0,
    band=DEPTHS,
    actions=(),
    observed=(*_LEG, _ROLL, _PITCH, *_OVER_GROUND, *_RATES),
    weights={"path": 0.5, "command_travel": COMMAND_TRAVEL, "progress": 0.5},
    duration=180.0,
    current=0.15,
)

PATH = Task(
    name="Path",
    unit="length",
    scale=5.0,
    band=DEPTHS,
    actions=("rudder_rad", "stern_plane_rad", PROPULSION),
    observed=(
        *_LEG,
        _ROLL,
        _PITCH,
        Observed("roll_rate", "p_radps", 1.0, "rate"),
        _PITCH_RATE,
        _YAW_RATE,
        _SURGE,
        _SWAY,
        _HEAVE,
        Observed("speed_ground", "u_dvl_mps", 1.0, "speed", offset=1.0),
        Observed("sway_ground", "v_dvl_mps", 0.5, "speed"),
        Observed("heave_ground", "w_dvl_mps", 0.5, "speed"),
        Observed("rudder", "rudder_rad"),
        Observed("stern_plane", "stern_plane_rad"),
        Observed("propulsion", PROPULSION),
    ),
    weights={"path": 0.5, "command_travel": COMMAND_TRAVEL, "progress": 0.5},
    duration=300.0,
    current=0.15,
    forms=(THRUST_PATH,),
)

# Floats
DIVE_DEPTHS = (0.5, 7.5)  # lengths; range of starts and targets
DIVE_LIMIT = 2.0  # times the deepest
SEA = 11_000.0  # m, the deepest target: the Challenger Deep has 10935 m (Greenaway et al. 2021, Deep-Sea Research I)
DIVE_TRIM = 0.1  # of the engine's half range: largest drawn error of the trim

FLOAT_DEPTH = Task(
    name="FloatDepth",
    vehicle="qiandao_float",
    channel="depth_m",
    unit="length",
    scale=3.0,
    step=(0.5, 3.0),
    hold=(4.0, 7.0),
    actions=(ENGINE,),
    observed=(
        Observed("depth_error", "error", 3.0, "length"),
        Observed("depth", "depth_m", 1.0, "deepest"),
        Observed("depth_rate", "depth_rate_mps", 1.0, "speed"),
        Observed("command", ENGINE),
        Observed("position", "position"),
    ),
    weights={"depth": 1.0, "command_travel": COMMAND_TRAVEL},
    duration=15.0,
)

# Gliders
GLIDER_HEADING = Task(
    name="GliderHeading",
    vehicle="slocum",
    channel="heading_rad",
    scale=pi,
    step=(radians(20.0), radians(70.0)),
    hold=(60.0, 180.0),  # s; the slowest preset turns 45 deg in 72 s
    actions=("rudder_rad",),
    observed=(
        Observed("heading_error_sin", "error_sin"),
        Observed("heading_error_cos", "error_cos"),
        Observed("turn_rate", "turn_rate", 2.0, "turn"),
        Observed("rudder", "rudder_rad"),
        Observed("speed", "speed", 1.0, "speed", offset=1.0),
    ),
    weights={"heading": 1.0, "command_travel": COMMAND_TRAVEL},
    duration=600.0,
)

# Flying gliders
TURNING = "turning"  # represents the vehicle's own channel: battery_roll_rad or rudder_rad
BOTTOM, SHALLOWEST = 200.0, 30.0  # m, default and smallest depth of the water
YOS = (2.0, 4.0)  # of a leg, in lengths, that is, yos
ARRIVAL = 0.33  # lengths; Seaglider operators count 2 km as reached, of the 6 km that a dive to 1000 m covers


def yo_plan(
    length: float, path_speed: float, slowness: float, pump: float, pumping: float, hotel: float
) -> dict[str, Any]:
    """The fields of a plan for the legs of a glider's yos and for their energy, in SI.

    length: m, distance covered by a yo; path_speed: m/s, the largest along a leg.  slowness: of the engine, s/m^3.
    pump: J per m^3 at a depth of 1 m.  pumping: W, of the pump over a usual yo.  hotel: W, of everything else.
    """
    return {
        "follows_path": 1.0,
        "leg": [k * length for k in YOS],
        "turn": pi,
        "slope": 0.0,
        "path_speed": path_speed,
        "radius": ARRIVAL * length,
        "target_band": (0.0, 0.0),
        "engine_rate": 1.0 / slowness if slowness > 0.0 else 1.0,
        "pump": pump,
        "hotel": hotel,
        "usual_power": pumping + hotel,
    }


GLIDE = Task(
    name="Glide",
    vehicle="seaglider",
    unit="length",
    scale=1.0,
    actions=("buoyancy_volume_m3", "battery_position_m", TURNING),
    observed=(
        Observed("across", "across", 1.0, "length"),
        Observed("remaining", "remaining", YOS[1], "length"),
        Observed("course_error_sin", "course_sin"),
        Observed("course_error_cos", "course_cos"),
        Observed("next_course_error_sin", "next_course_sin"),
        Observed("next_course_error_cos", "next_course_cos"),
        Observed("depth", "depth_m", 1.0, "deepest"),
        Observed("depth_rate", "sinking", 1.0, "speed"),
        _PITCH,
        _ROLL,
        Observed("current_along", "current_along", 1.0, "speed"),
        Observed("current_across", "current_across", 1.0, "speed"),
        Observed("buoyancy", "buoyancy_volume_m3"),
        Observed("battery", "battery_position_m"),
        Observed("turning", TURNING),
    ),
    weights={"path": 0.3, "energy": 0.2, "progress": 0.5},
    duration=16.0,  # yos
    current=0.4,
)

# Gliders in six degrees of freedom, moved by volume and masses
INSIDE = ("volume", "slide", "turn")  # represent the vehicle's own channels, by what they move, see `Command.inside`
WATER = 60.0  # m, default depth of the water: a Seawing needs 10 m to turn from a dive to a climb
DIVE_START = (0.2, 0.5)  # of the depth of the water, range of the start of an episode in a dive
HOTEL, PUMP_EFFICIENCY = 0.5, 0.25  # W, and 1: assumed, as in `vehicles.glide_steering`, as none are published
TURN_RATE = 0.2  # of the speed over the vehicle's own length: scale of a large rate of turn

GLIDE_BODY = replace(
    GLIDE,
    vehicle="seawing",
    actions=INSIDE,
    observed=(
        *(o for o in GLIDE.observed if o.source not in (*GLIDE.actions, "current_along", "current_across")),
        *_RATES,
        *(Observed(name, name) for name in INSIDE),
    ),
    current=0.15,
)
GLIDE = replace(GLIDE, forms=(GLIDE_BODY,))

TASKS = {
    task.name: task
    for task in (DEPTH, HEADING, SPEED, PATH, STATION_KEEPING, POSE_TASK, FLOAT_DEPTH, GLIDER_HEADING, GLIDE)
}
