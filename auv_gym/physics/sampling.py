"""What happens to a reading when it is sampled, besides a delay: noise, resolution, missing samples."""

from math import floor

from auv_gym.compiled import compiled


@compiled
def sampled(value, last, noise, resolution, dropout, normal, uniform):
    """The reading of a value; where the sample is missing, the last reading stands.

    noise: standard deviation.  resolution: step of the reading, 0 for none.  dropout: chance of a missing sample.
    normal, uniform: drawn numbers, from N(0, 1) and from [0, 1).
    """
    if uniform < dropout:
        return last
    value += noise * normal
    if resolution > 0.0:
        value = resolution * floor(value / resolution + 0.5)
    return value
