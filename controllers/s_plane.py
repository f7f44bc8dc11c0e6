"""S-plane control: a sigmoid of error and rate instead of a PID's proportional and derivative part."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, tanh

from controllers.tracking import OneChannel


@dataclass(frozen=True)
class SPlane(OneChannel):
    """S-plane law: command = neutral + span m, m = 2 / (1 + exp(-k1 e - k2 e')) - 1 + k3 integral of e dt.

    e and e' are the error over `error_scale` and its rate over `rate_scale`; the rate is that of the measurement, so
    that a step of the target does not kick.  m is limited to [-1, 1], its integral part to `integral_limit`; the
    integral is held while it would push the command further beyond a limit.  span: of the command, negative if it acts
    in the opposite direction.  For the other settings, see `controllers.tracking.OneChannel`.  Source: Xu, Zou, Yin and
    Cao 2013, Ocean Engineering 67, equation (21); the paper does not give its normalisation of inputs and output, so
    the scales are ours.

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
    integral_limit: float = 0.5

    def __post_init__(self) -> None:
        for name in ("k1", "k2", "k3"):
            if not 0.0 <= getattr(self, name) < inf:
                raise ValueError(f"SPlane needs {name} >= 0, got {getattr(self, name)!r}: the sign goes into span.")
        for name in ("error_scale", "rate_scale", "integral_limit"):
            if not 0.0 < getattr(self, name) < inf:
                raise ValueError(f"SPlane needs {name} > 0, got {getattr(self, name)!r}.")
        if not isfinite(self.span) or self.span == 0.0:
            raise ValueError(f"SPlane needs a span that is finite and not 0, got {self.span!r}.")
        self._check()

    def _answer(
        self, error: float, rate: float, steady: float, last: float, integral: float, dt: float
    ) -> tuple[float, float]:
        scaled = error / self.error_scale
        # the sigmoid of equation (21) is this hyperbolic tangent, which cannot overflow
        m = tanh(0.5 * (self.k1 * scaled - self.k2 * rate / self.rate_scale)) + integral
        wanted = steady + self.span * m
        bounded = wanted + self.span * (min(max(m, -1.0), 1.0) - m)
        command = self._within_limits(bounded, last, dt)
        growth = self.k3 * scaled * dt
        resting = growth * self.span * (wanted - command) > 0.0
        reached = integral if resting else integral + growth
        return command, min(max(reached, -self.integral_limit), self.integral_limit)
