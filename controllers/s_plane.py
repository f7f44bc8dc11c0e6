"""S-plane control: a sigmoid of error and rate in the place of a PID's proportional and derivative part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, isfinite, tanh

from controllers.tracking import Points, check_loop, error_of, filtered_rate, holding_command, limited


@dataclass(frozen=True)
class SPlaneState:
    """Memory of an SPlane: k3 times the integral, the filtered rate, last reading and command (None: none)."""

    integral: float = 0.0
    rate: float = 0.0
    reading: float | None = None
    command: float | None = None


@dataclass(frozen=True)
class SPlane:
    """Command = neutral + span m, m = 2 / (1 + exp(-k1 e - k2 e')) - 1 + k3 integral of e dt.

    e and e' are the error over `error_scale` and its rate over `rate_scale`; the rate is that of the measurement, so
    that a step of the target does not kick.  m is held within [-1, 1], its integral part within `integral_limit`, and
    that rests while it would push the command further beyond a limit.  span: of the command, negative where it acts the
    other way.  The rest is as in `Pid`.  Source: Xu, Zou, Yin and Cao 2013, Ocean Engineering 67, equation (21); the
    paper says that inputs and output are normalised and not by what, so the scales are ours.

    Example:

        >>> from controllers import SPlane
        >>> law = SPlane(k1=3.0, k2=2.0, k3=0.0, error_scale=1.0, rate_scale=0.2, span=0.35)
        >>> command, memory = law.act(law.start(), {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 0.5})
        >>> round(command["rudder_rad"], 3)
        0.222
    """

    k1: float
    k2: float
    k3: float
    error_scale: float
    rate_scale: float
    span: float
    measured: str = "heading_rad"
    command: str = "rudder_rad"
    filter_time: float = 0.0
    limit: float = inf
    rate_limit: float = inf
    integral_limit: float = 0.5
    neutral: float = 0.0
    middle: float = 0.0
    rate_measured: str = ""
    steady: Points = ()

    def __post_init__(self) -> None:
        for name in ("k1", "k2", "k3"):
            if not 0.0 <= getattr(self, name) < inf:
                raise ValueError(f"SPlane needs {name} >= 0, got {getattr(self, name)!r}: the sign goes into span.")
        for name in ("error_scale", "rate_scale", "integral_limit"):
            if not 0.0 < getattr(self, name) < inf:
                raise ValueError(f"SPlane needs {name} > 0, got {getattr(self, name)!r}.")
        if not isfinite(self.span) or self.span == 0.0:
            raise ValueError(f"SPlane needs a span that is finite and not 0, got {self.span!r}.")
        channels = [name for name in (self.measured, self.command, self.rate_measured) if name]
        check_loop(
            "SPlane", channels, self.filter_time, self.limit, self.rate_limit, self.neutral, self.middle, self.steady
        )

    @property
    def targets(self) -> tuple[str, ...]:
        return (self.measured,)

    @property
    def commands(self) -> tuple[str, ...]:
        return (self.command,)

    def start(self) -> SPlaneState:
        return SPlaneState()

    def act(
        self, state: SPlaneState, reading: Mapping[str, float], target: Mapping[str, float]
    ) -> tuple[dict[str, float], SPlaneState]:
        """The command and the next memory; without a finite reading both stay as they are."""
        measured, dt = reading[self.measured], reading["dt_s"]
        last = self.neutral if state.command is None else state.command
        if not isfinite(measured):
            return {self.command: last}, state
        error = error_of(self.measured, target[self.measured], measured) / self.error_scale
        rate = filtered_rate(self.measured, self.rate_measured, reading, state.reading, state.rate, self.filter_time)
        # the sigmoid of equation (21) is this hyperbolic tangent, which cannot overflow
        m = tanh(0.5 * (self.k1 * error - self.k2 * rate / self.rate_scale)) + state.integral
        wanted = holding_command(self.steady, target[self.measured], self.neutral) + self.span * m
        bounded = wanted + self.span * (min(max(m, -1.0), 1.0) - m)
        command = limited(bounded, last, self.middle, self.limit, self.rate_limit * dt)
        growth = self.k3 * error * dt
        resting = growth * self.span * (wanted - command) > 0.0
        integral = state.integral if resting else state.integral + growth
        integral = min(max(integral, -self.integral_limit), self.integral_limit)
        return {self.command: command}, SPlaneState(integral, rate, measured, command)
