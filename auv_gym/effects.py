"""Every physical effect that a vehicle may have, each neutral by default.

An effect at its neutral value is the identity, bit for bit, and acts at first order when it leaves it, so that
switching, fitting or probing one changes only numbers in the packed vector.  Stiction is the exception: its size is
searched for.  The compiled functions that apply the effects are in `physics`.  Probes are the smallest changes worth
detecting in a log of ten minutes.  The effects of floats and of flying gliders are in `vehicles.float_effects` and
`vehicles.glide_effects`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, make_dataclass
from math import pi
from typing import Any

from auv_gym.param import param, part
from auv_gym.physics.discovered import DiscoveredYaw
from auv_gym.physics.polynomials import DiscoveredForce, DiscoveredMoment

# The data in a log that set an effect apart from similar ones.
_SPEEDS = "a forward speed that varies"
_TURNED = "a forward speed that varies: a rudder's moment changes with it, a constant one does not"
_ROLLED = "a roll angle that varies, best moved on purpose"
_TURNS = "slow and fast turns"
_FIX = "a track, or a second source of heading"
_GYRO = "a gyro, which does not share the compass's lag"
_CIRCLE = "headings all around the circle, and a track or a gyro"
_TRACK = "a track over headings all around the circle"
_TILTED = "a known attitude at rest, and turns about one body axis at a time"
_ANGLES = "small and large movements of the {} to both sides"
_QUICK = "and sharp steps of the {}"
# The effects between a command and any actuator: neutral value, title, unit, bounds, and the data that
# would set it apart. `U` is the unit of the command, and bounds in it are those of an angle or of a share, to
# be multiplied by a `span`.
_ON_COMMANDS: Mapping[str, tuple[float, str, str, tuple[float, float], str]] = {
    "offset": (0.0, "{} offset", "U", (-0.5, 0.5), "a measured position of the {}, or commands that reach its stops"),
    "gain": (1.0, "{} gain", "1", (0.05, 5.0), "a measured position of the {}, or commands that reach its stops"),
    "deadband": (0.0, "{} deadband (half width)", "U", (0.0, 0.5), _ANGLES),
    "backlash": (0.0, "{} backlash (full width)", "U", (0.0, 0.5), _ANGLES),
    "stiction": (0.0, "{} stiction (smallest movement)", "U", (0.0, 0.5), _ANGLES),
    "dead_time": (0.0, "{} dead time", "s", (0.0, 20.0), f"samples shorter than the delay, {_QUICK}"),
    "lost_travel": (0.0, "early saturation of the {}", "U", (0.0, 1.0), "a measured position of the {}"),
    "lag": (0.0, "{} lag (time constant)", "s", (0.0, 60.0), f"samples shorter than the lag, {_QUICK}"),
    "slowness": (0.0, "{} rate limit, as time per angle", "s/U", (0.0, 200.0), "steps of the {} of different sizes"),
    "lost": (0.0, "share of the {} lost", "1", (0.0, 1.0), ""),
    "stuck": (0.0, "{} stuck (1 for wholly)", "1", (0.0, 1.0), ""),
    "stuck_at": (0.0, "angle at which the {} is stuck", "U", (-1.6, 1.6), ""),
}


def effects_on_commands(
    name: str,
    module: str,
    unit: str,
    probes: Mapping[str, float],
    *,
    span: float = 1.0,
    slowest: float | None = None,
    titles: Mapping[str, str] | None = None,
    more: Mapping[str, Any] | None = None,
) -> type:
    """A group of the effects of a kind of actuator; all kinds use this function.

    probes: for each effect to include, the smallest change that matters, 0 if no fit may free it.  unit: of the
    command, "1" for shares of its range.  span: of the bounds, over those of an angle.  slowest: largest slowness, s
    per unit.  titles: replace the usual ones.  more: further fields, made by `param`.  module: where pickle finds the
    class by its name.
    Order of action: gain and offset, deadband, backlash, stiction, dead time, saturation, then lag and rate limit.
    """
    fields: list[tuple[str, type, Any]] = []
    for effect, (neutral, title, stated, (low, high), apart) in _ON_COMMANDS.items():
        if effect not in probes:
            continue
        of_unit = stated in ("U", "s/U")
        scale = span if stated == "U" else 1.0
        high = slowest if effect == "slowness" and slowest is not None else high
        stated = stated.replace("U", unit).replace("s/1", "s") if of_unit else stated
        title = (titles or {}).get(effect, title)
        field = param(neutral, stated, title, bounds=(low * scale, high * scale), probe=probes[effect], apart=apart)
        fields.append((effect, float, field))
    fields += [(effect, float, field) for effect, field in (more or {}).items()]
    doc = f"What can happen between a command and what it moves ({unit}); see `effects_on_commands`."
    return make_dataclass(name, fields, frozen=True, namespace={"__module__": module, "__doc__": doc})


FIN_PROBES = {
    "offset": 0.010,
    "gain": 0.10,
    "deadband": 0.015,
    "backlash": 0.03,
    "stiction": 0.03,
    "dead_time": 0.5,
    "lost_travel": 0.04,
    "lag": 0.5,
    "slowness": 2.0,
}
ActuatorEffects = effects_on_commands("ActuatorEffects", __name__, "rad", FIN_PROBES)


@dataclass(frozen=True)
class ClockEffects:
    """Errors of a log's clocks, for every vehicle: the vehicle and its logger may keep different time.

    rate: a second of the vehicle is 1 + rate seconds of the log.  delay: lag of all readings behind the commands, in
    seconds of the log, for example if commands are stamped when sent and readings when they arrive.
    """

    rate: float = param(
        0.0,
        "1",
        "rate error of the log's clock",
        bounds=(-0.2, 0.25),  # farther off is a wrong unit or column, which the check of the log finds
        probe=0.01,
        apart="the start and end of the log by another clock",
    )
    delay: float = param(
        0.0,
        "s",
        "delay of all readings behind the commands",
        bounds=(0.0, 20.0),
        probe=0.2,
        apart="a step of each command by itself",
    )


@dataclass(frozen=True)
class YawEffects:
    """Yaw moments that a first model of heading leaves out; positive turns the bow to starboard."""

    moment: float = param(0.0, "N m", "constant yaw moment", bounds=(-50.0, 50.0), probe=0.004, apart=_TURNED)
    roll_moment: float = param(
        0.0, "N m/rad", "yaw moment from roll", bounds=(-100.0, 100.0), probe=0.10, apart=_ROLLED
    )
    speed_squared: float = param(
        0.0, "1", "rudder effectiveness with speed squared", bounds=(-3.0, 3.0), probe=0.15, apart=_SPEEDS
    )
    quadratic_damping: float = param(
        0.0, "N m s^2/rad^2", "quadratic yaw damping", bounds=(0.0, 1e5), probe=16.0, apart=_TURNS
    )


@dataclass(frozen=True)
class CompassEffects:
    """Errors of the measured heading: lag, deviation and constant bias."""

    bias: float = param(0.0, "rad", "compass bias", bounds=(-pi, pi), probe=0.02, apart=_FIX)
    lag: float = param(0.0, "s", "compass lag (time constant)", bounds=(0.0, 60.0), probe=0.5, apart=_GYRO)
    deviation_sin: float = param(
        0.0, "rad", "compass deviation, sine of heading", bounds=(-0.9, 0.9), probe=0.035, apart=_CIRCLE
    )
    deviation_cos: float = param(
        0.0, "rad", "compass deviation, cosine of heading", bounds=(-0.9, 0.9), probe=0.035, apart=_CIRCLE
    )


@dataclass(frozen=True)
class CurrentEffects:
    """Steady velocity of the water over ground."""

    north: float = param(0.0, "m/s", "steady current to the north", bounds=(-3.0, 3.0), probe=0.01, apart=_TRACK)
    east: float = param(0.0, "m/s", "steady current to the east", bounds=(-3.0, 3.0), probe=0.01, apart=_TRACK)


@dataclass(frozen=True)
class Sampling:
    """Sampling of a reading; no fit frees these parameters, since they are random or in whole samples."""

    delay: float = param(0.0, "s", "{} delay", bounds=(0.0, 20.0))
    noise: float = param(0.0, "channel's", "{} noise (standard deviation)", bounds=(0.0, 100.0))
    quantisation: float = param(0.0, "channel's", "{} resolution", bounds=(0.0, 100.0))
    dropout: float = param(0.0, "1", "chance that a reading of the {} is missing", bounds=(0.0, 1.0))


@dataclass(frozen=True)
class GliderTerms:
    """Yaw moments outside the named effects, found in data."""

    yaw: Any = part(DiscoveredYaw)


@dataclass(frozen=True)
class GliderSampling:
    """Sampling of a glider's readings."""

    compass: Sampling = part(Sampling, "compass")


@dataclass(frozen=True)
class GliderEffects:
    """All effects of the heading family."""

    rudder: Any = part(ActuatorEffects, "rudder")
    yaw: YawEffects = part(YawEffects)
    compass: CompassEffects = part(CompassEffects)
    current: CurrentEffects = part(CurrentEffects)
    discovered: GliderTerms = part(GliderTerms)
    sampling: GliderSampling = part(GliderSampling)
    clock: ClockEffects = part(ClockEffects)


@dataclass(frozen=True)
class FlowEffects:
    """Velocity of the water over ground in three dimensions: current + shear (depth - reference_depth)."""

    north: float = param(0.0, "m/s", "steady current to the north", bounds=(-3.0, 3.0), probe=0.01)
    east: float = param(0.0, "m/s", "steady current to the east", bounds=(-3.0, 3.0), probe=0.01)
    down: float = param(0.0, "m/s", "steady vertical current", bounds=(-1.0, 1.0), probe=0.01)
    shear_north: float = param(0.0, "1/s", "shear of the northward current", bounds=(-1.0, 1.0), probe=0.002)
    shear_east: float = param(0.0, "1/s", "shear of the eastward current", bounds=(-1.0, 1.0), probe=0.002)
    reference_depth: float = param(0.0, "m", "depth at which the steady current is stated", bounds=(0.0, 1.1e4))


@dataclass(frozen=True)
class WaveEffects:
    """A regular wave; surface elevation is amplitude_cos cos(phase) + amplitude_sin sin(phase), up."""

    amplitude_cos: float = param(0.0, "m", "wave amplitude, cosine part", bounds=(-10.0, 10.0), probe=0.05)
    amplitude_sin: float = param(0.0, "m", "wave amplitude, sine part", bounds=(-10.0, 10.0), probe=0.05)
    period: float = param(8.0, "s", "wave period", bounds=(1.0, 30.0))
    direction: float = param(0.0, "rad", "direction that waves travel to", bounds=(-2 * pi, 2 * pi))


@dataclass(frozen=True)
class WaterEffects:
    """Properties of the water."""

    density: float = param(0.0, "1", "relative excess of the water's density", bounds=(-0.2, 0.2), probe=0.003)


@dataclass(frozen=True)
class LoadEffects:
    """Weights and forces that a first model leaves out; body axes forward, starboard, down.

    A shift of the centre of gravity and a payload there leave the inertia about that centre as it is.
    """

    net_buoyancy: float = param(0.0, "N", "net buoyancy, up", bounds=(-1e4, 1e4), probe=0.2)
    x_g: float = param(0.0, "m", "centre of gravity shifted forward", bounds=(-1.0, 1.0), probe=0.002)
    y_g: float = param(0.0, "m", "centre of gravity shifted to starboard", bounds=(-0.2, 0.2), probe=0.001)
    z_g: float = param(0.0, "m", "centre of gravity shifted down", bounds=(-0.2, 0.2), probe=0.002)
    payload: float = param(0.0, "kg", "payload mass in water, at the centre of gravity", bounds=(-1e3, 1e3), probe=0.05)
    force_x: float = param(0.0, "N", "constant force forward", bounds=(-1e4, 1e4), probe=0.2)
    force_y: float = param(0.0, "N", "constant force to starboard", bounds=(-1e4, 1e4), probe=0.2)
    force_z: float = param(0.0, "N", "constant body force down", bounds=(-1e4, 1e4), probe=0.2)
    moment_x: float = param(0.0, "N m", "constant roll moment", bounds=(-1e4, 1e4), probe=0.02)
    moment_y: float = param(0.0, "N m", "constant pitch moment", bounds=(-1e4, 1e4), probe=0.1)
    moment_z: float = param(0.0, "N m", "constant yaw moment", bounds=(-1e4, 1e4), probe=0.1)
    tether_north: float = param(0.0, "N", "tether pull to the north", bounds=(-1e4, 1e4), probe=0.2)
    tether_east: float = param(0.0, "N", "tether pull to the east", bounds=(-1e4, 1e4), probe=0.2)
    tether_down: float = param(0.0, "N", "tether pull down", bounds=(-1e4, 1e4), probe=0.2)
    tether_drag: float = param(0.0, "kg/m", "tether drag", bounds=(0.0, 1e3), probe=0.1)
    tether_station: float = param(0.0, "m", "where the tether is tied, forward of the origin", bounds=(-10.0, 10.0))


@dataclass(frozen=True)
class HullEffects:
    """Relative errors of the hull's coefficients: `damping_sway` 0.1 is 10 % more of all damping in sway."""

    fouling: float = param(0.0, "1", "fouling: relative change in all drag", bounds=(-0.9, 5.0), probe=0.05)
    damping_surge: float = param(0.0, "1", "relative change in damping in surge", bounds=(-0.9, 5.0), probe=0.05)
    damping_sway: float = param(0.0, "1", "relative change in damping in sway", bounds=(-0.9, 5.0), probe=0.05)
    damping_heave: float = param(0.0, "1", "relative change in damping in heave", bounds=(-0.9, 5.0), probe=0.05)
    damping_roll: float = param(0.0, "1", "relative change in damping in roll", bounds=(-0.9, 5.0), probe=0.1)
    damping_pitch: float = param(0.0, "1", "relative change in damping in pitch", bounds=(-0.9, 5.0), probe=0.05)
    damping_yaw: float = param(0.0, "1", "relative change in damping in yaw", bounds=(-0.9, 5.0), probe=0.05)
    added_mass_surge: float = param(0.0, "1", "relative change in added mass in surge", bounds=(-0.9, 5.0), probe=0.1)
    added_mass_sway: float = param(0.0, "1", "relative change in added mass in sway", bounds=(-0.9, 5.0), probe=0.1)
    added_mass_heave: float = param(0.0, "1", "relative change in added mass in heave", bounds=(-0.9, 5.0), probe=0.1)
    added_mass_roll: float = param(0.0, "1", "relative change in added inertia in roll", bounds=(-0.9, 5.0), probe=0.2)
    added_mass_pitch: float = param(
        0.0, "1", "relative change in added inertia in pitch", bounds=(-0.9, 5.0), probe=0.1
    )
    added_mass_yaw: float = param(0.0, "1", "relative change in added inertia in yaw", bounds=(-0.9, 5.0), probe=0.1)


@dataclass(frozen=True)
class DiscoveredTerms:
    """Force terms outside the named effects, found in data; in addition to the hull's own polynomials."""

    surge: Any = part(DiscoveredForce, "discovered surge")
    sway: Any = part(DiscoveredForce, "discovered sway")
    heave: Any = part(DiscoveredForce, "discovered heave")
    roll: Any = part(DiscoveredMoment, "discovered roll")
    pitch: Any = part(DiscoveredMoment, "discovered pitch")
    yaw: Any = part(DiscoveredMoment, "discovered yaw")


@dataclass(frozen=True)
class DepthSensor:
    """Errors of the measured depth."""

    bias: float = param(0.0, "m", "depth sensor bias", bounds=(-100.0, 100.0), probe=0.05)
    scale: float = param(0.0, "1", "depth sensor scale error", bounds=(-0.5, 0.5), probe=0.01)
    lag: float = param(0.0, "s", "depth sensor lag (time constant)", bounds=(0.0, 60.0), probe=0.5)


@dataclass(frozen=True)
class Inclinometer:
    """Errors of the measured roll and pitch."""

    roll_bias: float = param(0.0, "rad", "roll sensor bias", bounds=(-1.0, 1.0), probe=0.01)
    pitch_bias: float = param(0.0, "rad", "pitch sensor bias", bounds=(-1.0, 1.0), probe=0.01)


@dataclass(frozen=True)
class Mount:
    """Rotation of the unit of gyros, compass and inclinometer in the vehicle, about the body axes, rad.

    All its readings rotate together, so that they agree with each other and disagree with the forces.
    """

    roll: float = param(0.0, "rad", "IMU turned about the forward axis", bounds=(-pi, pi), probe=0.01, apart=_TILTED)
    pitch: float = param(
        0.0, "rad", "IMU turned about the starboard axis", bounds=(-1.5, 1.5), probe=0.01, apart=_TILTED
    )
    yaw: float = param(0.0, "rad", "IMU turned about the downward axis", bounds=(-pi, pi), probe=0.02, apart=_TILTED)


@dataclass(frozen=True)
class SupplyEffects:
    """Effects of the battery on all thrusters together."""

    sag: float = param(
        0.0,
        "V/s",
        "fall of the supply voltage over a log",
        bounds=(-0.1, 0.1),
        probe=2e-3,
        apart="a measured supply voltage, or a longer log",
    )


@dataclass(frozen=True)
class Gyros:
    """Errors of the measured body rates."""

    bias_p: float = param(0.0, "rad/s", "roll gyro bias", bounds=(-1.0, 1.0), probe=0.003)
    bias_q: float = param(0.0, "rad/s", "pitch gyro bias", bounds=(-1.0, 1.0), probe=0.003)
    bias_r: float = param(0.0, "rad/s", "yaw gyro bias", bounds=(-1.0, 1.0), probe=0.003)
    scale: float = param(0.0, "1", "gyro scale error", bounds=(-0.5, 0.5), probe=0.02)
    misalignment: float = param(0.0, "rad", "gyros turned about the vertical axis", bounds=(-pi, pi), probe=0.02)
    lag: float = param(0.0, "s", "gyro lag (time constant)", bounds=(0.0, 60.0), probe=0.2)


@dataclass(frozen=True)
class VelocityLog:
    """Errors of a Doppler velocity log, over ground or through the water."""

    bias_u: float = param(0.0, "m/s", "{} bias forward", bounds=(-3.0, 3.0), probe=0.01)
    bias_v: float = param(0.0, "m/s", "{} bias to starboard", bounds=(-3.0, 3.0), probe=0.01)
    bias_w: float = param(0.0, "m/s", "{} bias down", bounds=(-3.0, 3.0), probe=0.01)
    scale: float = param(0.0, "1", "{} scale error", bounds=(-0.5, 0.5), probe=0.01)
    misalignment: float = param(0.0, "rad", "{} turned about the vertical axis", bounds=(-pi, pi), probe=0.01)
    lag: float = param(0.0, "s", "{} lag (time constant)", bounds=(0.0, 60.0), probe=0.5)


@dataclass(frozen=True)
class SamplingEffects:
    """Sampling of each sensor's readings."""

    depth: Sampling = part(Sampling, "depth sensor")
    compass: Sampling = part(Sampling, "compass")
    inclinometer: Sampling = part(Sampling, "inclinometer")
    gyros: Sampling = part(Sampling, "gyros")
    dvl_ground: Sampling = part(Sampling, "DVL over ground")
    dvl_water: Sampling = part(Sampling, "DVL through the water")
    position: Sampling = part(Sampling, "position")


@dataclass(frozen=True)
class BodyEffects:
    """The effects of every vehicle in six degrees of freedom, whatever its parts; each part adds its own."""

    current: FlowEffects = part(FlowEffects)
    waves: WaveEffects = part(WaveEffects)
    water: WaterEffects = part(WaterEffects)
    load: LoadEffects = part(LoadEffects)
    hull: HullEffects = part(HullEffects)
    discovered: DiscoveredTerms = part(DiscoveredTerms)
    depth: DepthSensor = part(DepthSensor)
    compass: CompassEffects = part(CompassEffects)
    inclinometer: Inclinometer = part(Inclinometer)
    gyros: Gyros = part(Gyros)
    mount: Mount = part(Mount)
    supply: SupplyEffects = part(SupplyEffects)
    dvl_ground: VelocityLog = part(VelocityLog, "DVL over ground")
    dvl_water: VelocityLog = part(VelocityLog, "DVL through the water")
    sampling: SamplingEffects = part(SamplingEffects)
    clock: ClockEffects = part(ClockEffects)
