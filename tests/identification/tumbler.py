"""A small thruster vehicle that loops through the vertical, and logs of it; its numbers are invented."""

import numpy as np
from scipy.spatial.transform import Rotation

from auv_gym.model import simulate
from auv_gym.plant import Plant, vehicle_of_text
from auv_gym.records.record import Record

_HULL = """
family = "body"
name = "tumbler"
title = "A small thruster vehicle that loops"
dt_s = 0.1
longest_step_s = 0.05
window_s = 10.0
settle_s = 1.5
"""
_NUMBERS = {
    "hull": "density=1000.0 length=0.5 diameter=0.3 mass=8.0 buoyancy=78.48 z_g=0.01 i_xx=0.1 i_yy=0.12 i_zz=0.12",
    "hull.added_mass": "x_udot=-4.0 y_vdot=-6.0 z_wdot=-8.0 k_pdot=-0.08 m_qdot=-0.1 n_rdot=-0.1",
    "hull.surge": "u=-5.0",
    "hull.sway": "v=-8.0",
    "hull.heave": "w=-10.0",
    "hull.roll": "p=-0.3",
    "hull.pitch": "q=-0.35",
    "hull.yaw": "r=-0.3",
    "parts.bow": "x=0.2 to_x=0.0 to_z=1.0",
    "parts.stern": "x=-0.2 to_x=0.0 to_z=1.0",
    "parts.port": "y=-0.15",
    "parts.starboard": "y=0.15",
    "parts.top": "z=-0.1 to_x=0.0 to_y=1.0",
    "parts.bottom": "z=0.1 to_x=0.0 to_y=1.0",
    "parts.spare": "",  # eight thrusters, as bluerov2_heavy has: its programs need not be compiled anew
    "parts.idle": "",
}
DAMPING = ("hull.roll.p", "hull.pitch.q", "hull.yaw.r")
ATTITUDE, RATES = ("roll_rad", "pitch_rad", "heading_rad"), ("p_radps", "q_radps", "r_radps")
NOISE = 0.02  # rad about each axis, and rad/s
MOVED = ("bow_share", "stern_share", "port_share", "starboard_share", "top_share", "bottom_share")
INPUTS = (*MOVED, "spare_share", "idle_share")


def tumbler() -> Plant:
    lines = [_HULL]
    for table, numbers in _NUMBERS.items():
        lines.append(f"[{table}]")
        if table.startswith("parts."):
            lines.append('kind = "thruster"\ncommand = "share"\ncurve = [[-1.0, -20.0], [1.0, 20.0]]')
        lines += ["{} = {{ value = {} }}".format(*number.split("=")) for number in numbers.split()]
    return vehicle_of_text("\n".join(lines), "a test")


def flown(plant: Plant, seed: int, seconds: float = 60.0, strength: float = 0.2, noise: float = NOISE) -> Record:
    """A log of attitude and rates under telegraph commands of some strength, read with noise about each axis."""
    rng, count = np.random.default_rng(seed), int(seconds / plant.dt)
    held = np.repeat(rng.choice([-1.0, 0.0, 1.0], (count // 8 + 1, 3)), 8, axis=0)[:count] * strength
    pitch, yaw, roll = held.T
    none = 0.0 * roll
    commands = dict(zip(INPUTS, (pitch, -pitch, yaw, -yaw, roll, none, none, none), strict=True))
    true = simulate(plant, Record.from_arrays(plant.dt * np.arange(count), commands))
    attitude = Rotation.from_euler("ZYX", true.matrix(ATTITUDE[::-1]))
    read = (attitude * Rotation.from_rotvec(noise * rng.standard_normal((count, 3)))).as_euler("ZYX")[:, ::-1]
    rates = true.matrix(RATES) + noise * rng.standard_normal((count, 3))
    readings = dict(zip((*ATTITUDE, *RATES), np.hstack([read, rates]).T, strict=True))
    return Record.from_arrays(true.time, {**commands, **readings})
