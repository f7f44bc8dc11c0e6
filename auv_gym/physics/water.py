"""Wave motion of the water; current and shear are simple enough to be computed where they are used."""

from math import cos, exp, pi, sin

from auv_gym.compiled import compiled


@compiled
def orbital_velocity(phase, depth, waves, gravity):
    """Velocity along the wave's direction and down, m/s, of a regular wave in deep water, at a phase and a depth.

    Elevation amplitude_cos cos(phase) + amplitude_sin sin(phase), phase = omega t - k x; k = omega^2/g.
    Above still water the velocity is that at the surface.  Source: Faltinsen 1990, table 2.1 (deep water).
    """
    omega = 2.0 * pi / waves.period
    reach = omega * exp(-omega * omega / gravity * max(depth, 0.0))
    c, s = cos(phase), sin(phase)
    along = reach * (waves.amplitude_cos * c + waves.amplitude_sin * s)
    down = reach * (waves.amplitude_cos * s - waves.amplitude_sin * c)
    return along, down
