"""The static relation from a glider's masses, fin and engine to its attitude and turn."""

from __future__ import annotations

from dataclasses import dataclass

from auv_gym.param import param


@dataclass(frozen=True)
class Steering:
    """Pitch, roll and turn of a glider that flies without a log, and the energy of its pump.

    pitch = pitch + pitch_mass battery_position + pitch_engine engine volume, and roll = roll + roll_mass battery_roll.
    The turn rate is speed (turn_roll attack sin(roll) + turn_rudder rudder), rad/s: wings behind the middle push the
    stern sideways when the glider is rolled.  All neutral: the relation is unknown.
    """

    pitch: float = param(0.0, "rad", "pitch with battery and engine at 0", bounds=(-10.0, 10.0))
    pitch_mass: float = param(0.0, "rad/m", "pitch per way of the battery", bounds=(-1e3, 1e3))
    pitch_engine: float = param(0.0, "rad/m^3", "pitch per volume of the engine", bounds=(-1e5, 1e5))
    roll: float = param(0.0, "rad", "roll with the battery upright", bounds=(-0.5, 0.5))
    roll_mass: float = param(0.0, "1", "roll per angle of the battery", bounds=(-10.0, 10.0))
    turn_roll: float = param(0.0, "1/m", "turn per way, angle of attack and sine of roll", bounds=(-20.0, 20.0))
    turn_rudder: float = param(0.0, "1/m", "turn per way and rudder", bounds=(-2.0, 2.0))
    battery_low: float = param(-0.01, "m", "hindmost or foremost position of the battery", bounds=(-1.0, 1.0))
    battery_high: float = param(0.01, "m", "the other end of its way", bounds=(-1.0, 1.0))
    battery_slowness: float = param(0.0, "s/m", "rate limit of the battery, as time per way", bounds=(0.0, 1e5))
    roll_limit: float = param(0.5, "rad", "largest angle of the battery", bounds=(0.01, 3.0))
    roll_slowness: float = param(
        0.0, "s/rad", "rate limit of the battery's angle, as time per angle", bounds=(0.0, 1e3)
    )
    rudder_limit: float = param(0.5, "rad", "largest rudder", bounds=(0.01, 1.5))
    lag: float = param(0.0, "s", "lag of the attitude behind masses and rudder", bounds=(0.0, 600.0))
    pump_slowness: float = param(0.0, "s/m^3", "rate limit of the engine, as time per volume", bounds=(0.0, 1e9))
    pump_efficiency: float = param(0.25, "1", "share of the pump's power that lifts", bounds=(0.01, 1.0))
    hotel: float = param(0.5, "W", "power of all but the pump", bounds=(0.0, 100.0))
