"""Sensor effects: from a true signal to its reading."""

from math import cos, exp, floor, sin

from auv_gym.compiled import compiled


@compiled
def deviation(heading, compass):
    """Heading error of a compass near magnetic material, rad: the semicircular terms, sine and cosine of heading.

    Source: Bowditch, American Practical Navigator, 2019, ch. 8 (coefficients B and C).
    """
    return compass.deviation_sin * sin(heading) + compass.deviation_cos * cos(heading)


@compiled
def lag_error(error, change, lag, duration):
    """The error of a first-order sensor after its input has changed by `change` as a ramp.

    Exact for a ramp; zero, bit for bit, at lag 0 from zero.  lag, duration: s.
    """
    if lag <= 0.0:
        return 0.0
    decay = exp(-duration / lag)
    return error * decay - change / duration * lag * (1.0 - decay)


@compiled
def compass_reading(heading, error, compass):
    """The reading of a compass, rad, with the lag's present error."""
    return heading + deviation(heading, compass) + error + compass.bias


@compiled
def sampled(value, last, noise, resolution, dropout, normal, uniform):
    """The reading of a value; if the sample is missing, the last reading is kept.

    noise: standard deviation.  resolution: step of the reading, 0 for none.  dropout: probability of a missing sample.
    normal, uniform: drawn numbers, from N(0, 1) and from [0, 1).
    """
    if uniform < dropout:
        return last
    value += noise * normal
    if resolution > 0.0:
        value = resolution * floor(value / resolution + 0.5)
    return value
