"""Energy of a buoyancy engine's pump and of the hotel load in a step: compiled parts shared by kinds of glider.

`PLAN`, `ROW` and `SHOWN` list the fields that they need.
"""

from __future__ import annotations

from auv_gym.compiled import compiled

# engine_rate: m^3/s.  pump: J per m^3 at a depth of 1 m.  hotel, usual_power: W.
PLAN = {"engine_rate": 1, "pump": 1, "hotel": 1, "usual_power": 1}
ROW = {"engine": 1}  # m^3, position of the engine, limited by its rate
SHOWN = {"energy": 1}  # J, since the episode began


@compiled
def energy_term(told, depth, t, e):
    """The reward term of the energy of a step, in which the engine moves towards a volume, m^3, at its rate.

    The pump works against the pressure at a depth, m; the valve uses no energy.
    """
    most = t.engine_rate * t.dt
    move = min(max(told - e.engine, -most), most)
    e.engine += move
    energy = t.pump * max(depth, 0.0) * max(move, 0.0) + t.hotel * t.dt
    e.energy += energy
    return -t.weight[1] * energy / (t.usual_power * t.dt)
