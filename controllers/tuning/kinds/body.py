"""Trials and initial gains of vehicles in six degrees of freedom: depth by pitch, heading, speed."""

from __future__ import annotations

from auv_gym.plant import Plant
from auv_gym.plant.cruise import command_limits, find_cruise, find_helm
from controllers.gains import Loops
from controllers.trials.trial import Steps, level_flight
from controllers.tuning.kinds import OFF, SEGMENT, Moved, Trial, TuningKind, law

TABLE_4 = {"heading": (0.9, 1.7, 0.0024), "depth": (2.3, 2.4, 0.00006), "speed": (0.8, 0.1, 0.02)}  # Xu et al. 2013
_PITCH_LIMIT = 0.35  # rad
_BOW_SHARE = -1.0  # bow planes opposed to stern planes: a moment without a force
_VERTICAL = ("hull.heave.uw", "hull.pitch.uw", "hull.pitch.uq", "parts.stern_plane.moment")
_LOOPS = {
    "pid": {"u_mps": ("speed",), "heading_rad": ("heading",), "depth_m": ("pitch", "depth")},
    "s_plane": {"u_mps": ("speed",), "heading_rad": ("heading",), "depth_m": ("depth",)},
}


def _trial(plant: Plant) -> Trial:
    cruise, length = find_cruise(plant), plant.hull.length
    scale = max(length / cruise.speed, 3.0 * plant.dt)
    duration, deep = 2.0 * SEGMENT * scale, 20.0 * length
    steps: Steps = {
        "depth_m": [(0.0, deep + 4.0 * length), (0.5 * duration, deep + 3.0 * length)],
        "heading_rad": [(0.0, 0.9), (0.5 * duration, 0.4)],
        "u_mps": [(0.0, 0.8 * cruise.speed), (0.4 * duration, cruise.speed)],
    }
    held = {"depth_m": deep, "heading_rad": 0.0, "u_mps": cruise.speed}
    # a sharp turn costs more speed than a step of its target
    return Trial(steps, held, duration, scale, lambda plant: level_flight(plant, deep), ("u_mps",))


def _first(plant: Plant, of_law: str) -> Loops:
    """Initial gains from the environments' linear-quadratic regulators, with slow integrals."""
    cruise, limits, helm = find_cruise(plant), command_limits(plant), find_helm(plant)
    length, speed = plant.hull.length, cruise.speed
    time = length / speed
    _, turn, rudder = (float(gain) for gain in cruise.rudder_gains)
    _, rate, pitch, depth = (float(gain) for gain in cruise.plane_gains)
    push = 0.5 * float(limits[helm.drive]) / speed
    by_pitch = depth / pitch
    if of_law == "pid":
        return {
            "speed": {"proportional": push, "integral": push / (10.0 * time), "integral_range": 0.3 * speed},
            "heading": law(rudder, rudder / (20.0 * time), turn, integral_range=0.2),
            "pitch": law(pitch, pitch / (10.0 * time), rate, integral_range=0.2),
            "depth": law(by_pitch, by_pitch / (40.0 * time), integral_range=0.5 * length, limit=_PITCH_LIMIT),
        }
    scales = {
        "speed": (speed, 1.0 * speed / time),
        "heading": _scales("heading", float(limits[helm.rudder]), rudder, turn),
        "depth": _scales("depth", float(limits[helm.plane]), pitch * by_pitch, pitch / speed),
    }
    filters = {"speed": time, "heading": 0.0, "depth": time}
    return {
        name: {
            **dict(zip(("k1", "k2", "k3"), TABLE_4[name], strict=True)),
            "error_scale": scales[name][0],
            "rate_scale": scales[name][1],
            "filter_time": filters[name],
        }
        for name in ("speed", "heading", "depth")
    }


def _scales(loop: str, span: float, proportional: float, derivative: float) -> tuple[float, float]:
    """Scales of error and rate with which the command for a small error is that of these gains."""
    k1, k2, _ = TABLE_4[loop]
    return 0.5 * span * k1 / abs(proportional), 0.5 * span * k2 / abs(derivative)


def _moved_by(plant: Plant, name: str) -> Moved:
    helm = find_helm(plant)
    index = {"heading_rad": helm.rudder, "depth_m": helm.plane, "u_mps": helm.drive}[name]
    limit = float(command_limits(plant)[index])
    return Moved(plant.inputs[index], limit if index == helm.drive else 2.0 * limit)


def _mirror(plant: Plant, name: str, share: float) -> dict[str, float]:
    bow = plant.family.body.by_role()["pitch"][1:2] if name == "depth_m" and share != 0.0 else ()
    return dict.fromkeys(bow, share)


def _offsets(plant: Plant) -> dict[str, float]:
    helm, limits, commands = find_helm(plant), command_limits(plant), plant.family.body.commands
    return {f"effects.{commands[at][0].name}.offset": OFF * float(limits[at]) for at in (helm.rudder, helm.plane)}


KIND = TuningKind(
    trial=_trial,
    first=_first,
    loops=lambda plant, of_law: _LOOPS[of_law],
    moved_by=_moved_by,
    bow_share=lambda plant: _BOW_SHARE if len(plant.family.body.by_role()["pitch"]) > 1 else 0.0,
    mirror=_mirror,
    offsets=_offsets,
    besides=_VERTICAL,
)
