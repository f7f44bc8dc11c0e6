"""PID control of one channel by one command, and its gains for the heading of a glider and the depth of a float."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite

from auv_gym.physics.buoyancy import GRAVITY
from auv_gym.plant import Plant, check_vehicle
from auv_gym.vehicles.glider import GliderHull, linear_yaw_coefficients
from auv_gym.vehicles.profiling_float import steady_speed
from controllers.tracking import OneChannel

_INTEGRAL_RANGE = 0.2618  # rad, 15 deg: more than any steady error, less than a change of course
_SLOW = 0.2  # the third pole over the other two
_NEAR_REST = 0.1  # of a float's top speed: its dynamics where its controller has to settle it


@dataclass(frozen=True)
class Pid(OneChannel):
    """PID with a filtered derivative of the measurement; errors of angles are wrapped.

    Gains: command per error, per error and s, per rate of the reading; negative if the command acts in the opposite
    direction.
    integral_range: error beyond which nothing is integrated, so that a large step of the target does not cause
    overshoot.  For the other settings, see `controllers.tracking.OneChannel`.
    Against windup, the integral is also held while the error pushes the command further beyond a limit (clamping).
    Source: Astrom and Hagglund 2006, Advanced PID Control, sec. 3.3 and 3.5.

    Example:

        >>> from controllers import Pid
        >>> pid = Pid(proportional=0.8, integral=0.1, limit=0.3)
        >>> command, memory = pid.act(pid.start(), {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 0.2})
        >>> round(command["rudder_rad"], 3)
        0.16
    """

    proportional: float
    integral: float = 0.0
    derivative: float = 0.0
    integral_range: float = inf

    def __post_init__(self) -> None:
        for name in ("proportional", "integral", "derivative"):
            if not isfinite(getattr(self, name)):
                raise ValueError(f"Pid needs a finite {name} gain, got {getattr(self, name)!r}.")
        if self.proportional * self.integral < 0.0 or self.proportional * self.derivative < 0.0:
            raise ValueError(
                f"Pid needs gains of one sign, got {self.proportional:g}, {self.integral:g}, {self.derivative:g}: "
                "make them all negative where the command acts the other way."
            )
        if not self.integral_range > 0.0:
            raise ValueError(f"Pid needs integral_range > 0, got {self.integral_range!r}.")
        self._check()

    def _answer(
        self, error: float, rate: float, steady: float, last: float, integral: float, dt: float
    ) -> tuple[float, float]:
        wanted = steady + self.proportional * error + integral - self.derivative * rate
        command = self._within_limits(wanted, last, dt)
        growth = self.integral * error * dt
        resting = abs(error) > self.integral_range or growth * (wanted - command) > 0.0
        return command, integral if resting else integral + growth


def heading_pid(plant: Plant, *, settling: float | None = None, rate_limit: float = inf) -> Pid:
    """A heading controller with poles placed for the plant's linear form at nominal speed, without effects.

    From rudder to heading the form is k / (s (T s + 1)); with equation (15) k has the direct term K_y3. Two poles go to
    -1/settling and one to a fifth of that. If the lag T is too short to matter, the derivative gain is zero and only
    the two slower poles are placed.  settling: s, default the larger of T and 3 samples.
    Raises for other vehicles, or if the rudder does not turn this one.  Source: Astrom and Murray 2021, sec. 8.2.

    Example:

        >>> from auv_gym import load_vehicle
        >>> from controllers import heading_pid
        >>> pid = heading_pid(load_vehicle("slocum"))
        >>> round(pid.proportional, 2), round(pid.limit, 2)
        (1.5, 0.6)
    """
    check_vehicle("heading_pid", plant)
    if not isinstance(plant.hull, GliderHull):
        raise ValueError(
            f"heading_pid places poles on a glider's linear form, got {plant.name!r} of family {plant.family.name!r}: "
            "give a Pid gains of your own."
        )
    hull = plant.hull
    damping, rudder = linear_yaw_coefficients(plant.family.view(plant.vector).hull)
    damping, rudder = hull.damping_factor * damping, hull.rudder_factor * rudder
    gain = hull.rudder_heading_rate - rudder / damping if damping < 0.0 else 0.0
    if abs(gain) < 1e-9:
        raise ValueError(
            f"The rudder of {plant.name!r} does not turn it steadily (damping {damping:g} 1/s, rudder {rudder:g} "
            "1/s^2): check hull.n_r and hull.n_delta."
        )
    # With K_y3, the rudder also moves the heading directly; the lag applies to the rest.
    lag = (rudder / damping) / (rudder / damping - hull.rudder_heading_rate) / -damping
    lag = max(lag, 0.0)
    if settling is None:
        settling = max(3.0 * plant.dt, lag)
    elif not 0.0 < settling < inf:
        raise ValueError(f"heading_pid needs settling > 0 s, got {settling!r}.")
    return Pid(
        *_placed(gain, lag, 1.0 / settling),
        filter_time=plant.dt,
        limit=hull.rudder_limit,
        rate_limit=rate_limit,
        integral_range=_INTEGRAL_RANGE,
    )


def float_depth_pid(plant: Plant, *, settling: float | None = None, rate_limit: float | None = None) -> Pid:
    """A depth controller by the piston with poles placed for the float's linear form near rest, without effects.

    Two poles go to -1/settling and one to a fifth of that, as in `heading_pid`. It starts from the neutral position,
    integrates only where the error alone would not drive the piston to an end, and moves the command no faster than the
    piston.  settling: s, default the largest of the float's lag, 3 samples, and 1.5 times the piston's travel time to
    an end of its range.  rate_limit: m/s, default the piston's.
    Raises for vehicles without a piston.  Source: Astrom and Murray 2021, sec. 8.2; the form is equation (5) of Zhong
    et al. 2024, linearised.

    Example:

        >>> from auv_gym import load_vehicle
        >>> from controllers import float_depth_pid
        >>> pid = float_depth_pid(load_vehicle("qiandao_float"))
        >>> round(pid.proportional, 4), pid.command
        (-0.015, 'piston_m')
    """
    check_vehicle("float_depth_pid", plant)
    if "piston_m" not in plant.family.required:
        raise ValueError(
            f"float_depth_pid moves a float's piston, got {plant.name!r} of family {plant.family.name!r}: take a "
            "vehicle of family 'float_piston', such as 'qiandao_float'."
        )
    hull = plant.hull
    half, slowness = 0.5 * (hull.piston_high - hull.piston_low), float(hull.piston_slowness)
    force = hull.density * GRAVITY * hull.piston_area + 2.0 * hull.piston_square * abs(hull.piston_neutral)
    fastest = float(steady_speed(force * half, hull.drag_linear, hull.drag_quadratic))
    damping = hull.drag_linear + 2.0 * hull.drag_quadratic * _NEAR_REST * fastest
    lag = float((hull.mass + hull.added_mass) / damping)
    if settling is None:
        settling = max(lag, 3.0 * plant.dt, 1.5 * float(half) * slowness)
    if not 0.0 < settling < inf:
        raise ValueError(f"float_depth_pid needs settling > 0 s, got {settling!r}.")
    if rate_limit is None:
        rate_limit = 1.0 / slowness if slowness > 0.0 else inf
    proportional, integral, derivative = _placed(-force / damping, lag, 1.0 / settling)
    return Pid(
        proportional,
        integral,
        derivative,
        measured="depth_m",
        command="piston_m",
        filter_time=0.25 * settling,
        limit=half,
        rate_limit=rate_limit,
        integral_range=half / abs(proportional),
        neutral=hull.piston_neutral,
        middle=0.5 * (hull.piston_high + hull.piston_low),
    )


def _placed(gain: float, lag: float, pole: float) -> tuple[float, float, float]:
    """Proportional, integral and derivative gains that put two poles of gain / (s (lag s + 1)) at -pole, one near 0."""
    derivative = lag * (2.0 + _SLOW) * pole - 1.0
    if derivative > 0.0:
        proportional, integral = lag * (1.0 + 2.0 * _SLOW) * pole**2, lag * _SLOW * pole**3
    else:
        rest = 1.0 - (1.0 + _SLOW) * pole * lag
        derivative = 0.0
        proportional, integral = _SLOW * pole**2 * lag + (1.0 + _SLOW) * pole * rest, _SLOW * pole**2 * rest
    return proportional / gain, integral / gain, derivative / gain
