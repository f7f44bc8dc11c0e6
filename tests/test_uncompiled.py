"""The physics as plain Python: the same trajectories as compiled, to rounding."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import list_paths, replace_at, spec_at
from auv_gym.plant import Plant, list_vehicles, load_vehicle
from auv_gym.plant.cruise import command_ranges, find_helm
from auv_gym.plant.thrusters import find_thrusters
from auv_gym.records.record import Record
from auv_gym.vehicles.body.learned_hull import LearnedHull
from tests.plain_python import run_plain
from tests.presets import UNCOMPILED

SAMPLES = {
    "glider": 60,
    "body": 12,
    "hover": 12,
    "float": 25,
    "glide": 25,
    "glide_body": 12,
}  # one of a torpedo takes plain Python some milliseconds
OTHERS = {
    "effects.discovered.sway.wp": 20.0,
    "effects.discovered.yaw.sin_heading": 0.5,
    "effects.discovered.yaw.sin_2heading": 0.1,
    "effects.discovered.yaw.u_rudder": -0.2,
    "effects.discovered.yaw.wr": 1.0,
    "effects.discovered.heave.depth": 0.01,
    "effects.discovered.heave.root_w": -0.3,
    "effects.discovered.heave.www": -2.0,
    "effects.discovered.heave.piston_squared": 3.0,
    "effects.current.reference_depth": 3.0,
    "effects.waves.direction": 0.7,
    "effects.load.tether_station": -0.5,
    "effects.rudder.stuck_at": 0.1,
}


def probed(plant: Plant) -> dict[str, float]:
    """Every effect at three probes, and some values that have none."""
    paths = [path for path in list_paths(plant) if path.startswith("effects.")]
    values = {path: spec_at(plant, path).neutral + 3.0 * spec_at(plant, path).probe for path in paths}
    return {path: OTHERS.get(path, value) for path, value in values.items()}


def together() -> dict[str, Plant]:
    """The presets bare, but for those whose programs no other daily test has, and some with all effects."""
    found = {name: load_vehicle(name) for name in list_vehicles() if name not in UNCOMPILED}
    for name in ("slocum", "ganeshblue_corrected", "heu_torpedo", "npsauv", "qiandao_float", "mermaid", "seaglider"):
        found[f"{name}, all effects"] = replace_at(found[name], probed(found[name]))
    centres = np.linspace(-0.5, 1.5, 4)[:, None] * np.array([1.0, 0.1, 0.1, 0.2, 0.2, 0.2])
    forces = np.array([[-4.0, 2.0, 1.0, 0.2, 0.4, -0.3]]) * np.arange(1.0, 5.0)[:, None]
    learned = LearnedHull(centres, np.ones(6), np.array([1.0, 0.5]), np.stack([forces, -forces]), np.ones(6), 1.0)
    found["heu_torpedo, learned"] = replace(found["heu_torpedo"], learned=learned)
    return found


def alone() -> dict[str, Plant]:
    """A glider with each effect, and others with each group of effects."""
    slocum, found = load_vehicle("slocum"), {name: load_vehicle(name) for name in UNCOMPILED}
    found |= {f"slocum, {path}": replace_at(slocum, path, value) for path, value in probed(slocum).items()}
    for name in ("heu_torpedo", "qiandao_float", "mermaid"):
        plant = load_vehicle(name)
        for group in {path.split(".")[1] for path in probed(plant)}:
            values = {path: value for path, value in probed(plant).items() if path.split(".")[1] == group}
            found[f"{name}, {group}"] = replace_at(plant, values)
    return found


PLANTS = {"together": together, "alone": alone}


def trajectory(plant: Plant) -> np.ndarray:
    """Outputs of a rollout and of the same commands stepped one by one, shape (2, samples, n_outputs)."""
    k = np.arange(SAMPLES[plant.family.kind])
    columns = {"rudder_rad": 0.6 * np.sin(0.3 * k)}
    start = {"heading_rad": 0.3, "r_radps": 0.01}
    if plant.family.kind == "float":
        oil = {"pumped_volume_m3": 5e-5 * (k // 7), "valved_volume_m3": 4e-5 * (k // 9)}
        columns = {**oil, "valved_depth_m4": 3e-4 * (k // 9), "oil_volume_m3": 5e-5 * (k // 7) - 4e-5 * (k // 9)}
        columns |= {"piston_m": 0.55 + 0.06 * np.sin(0.3 * k), "temperature_C": 14.0 + np.cos(0.2 * k)}
        columns |= {"elapsed_s": plant.dt * k, "density_gradient_kgpm4": np.full(k.size, 0.01)}
        start = {"depth_m": 1.0, "depth_rate_mps": -0.1}  # to the surface and back
    elif plant.family.kind == "glider":
        columns |= {"u_mps": 0.4 + 0.1 * np.sin(0.1 * k), "roll_rad": 0.1 * np.cos(0.2 * k)}
    elif plant.family.kind == "glide":
        columns = {"buoyancy_volume_m3": plant.hull.engine_neutral - 3e-4 * np.sin(0.3 * k)}
        columns |= {"pitch_rad": -0.4 * np.sin(0.3 * k), "heading_rad": 0.1 * k, "temperature_C": 9.0 + np.cos(0.2 * k)}
        start = {"depth_m": 4.0}  # to the surface and back
    elif plant.family.kind == "hover":
        thrusters = find_thrusters(plant)
        waves = 0.9 * np.sin(0.5 * k[:, None] + np.arange(thrusters.at.size))
        low, rest, high = command_ranges(plant).T
        columns = dict(zip(thrusters.channels, (rest + 0.5 * (high - low) * waves).T, strict=True))
        columns |= {"supply_V": 15.0 + np.cos(k)}
        plant = replace(plant, longest_step=0.5 * plant.dt)
        start |= {"u_mps": 0.2, "v_mps": 0.1, "w_mps": -0.1, "p_radps": 0.1, "depth_m": 4.0, "pitch_rad": 0.1}
    elif plant.family.body.glides:
        columns = {"ballast_m3": -4e-4 * np.cos(0.1 * k), "battery_m": 0.03 * np.sin(0.2 * k), "battery_rad": 0.02 * k}
        start |= {"u_mps": 0.4, "v_mps": 0.1, "w_mps": -0.1, "p_radps": 0.1, "depth_m": 50.0, "pitch_rad": 0.1}
    else:
        columns |= {"stern_plane_rad": 0.3 * np.cos(0.5 * k), "bow_plane_rad": 0.2 * np.sin(0.7 * k)}
        plant = replace(plant, longest_step=0.5 * plant.dt)
        columns[plant.inputs[find_helm(plant).drive]] = plant.parts.propeller.design * (1.0 + 0.2 * np.sin(k))
        start |= {"u_mps": 1.2, "v_mps": 0.1, "w_mps": -0.1, "p_radps": 0.1, "depth_m": 4.0, "pitch_rad": 0.1}
    record = Record.from_arrays(plant.dt * k, columns)
    x = plant.initial(np.array([start.get(name, 0.0) for name in plant.outputs]))
    rolled, stepped = plant.run(record, record.segments, x[None, :]), []
    for row in k:
        u = np.array([record[name][row] if record.has(name) else plant.constants[name] for name in plant.inputs])
        stepped.append(plant.output(x))
        x = plant.step(x, u)
    return np.stack([rolled, np.array(stepped)])


@pytest.mark.parametrize("which", ["together", pytest.param("alone", marks=pytest.mark.slow)])
def test_plain_python_agrees_with_compiled_code(which, tmp_path):
    out = tmp_path / "plain.npz"
    run_plain(__file__, which, out)
    with np.load(out) as plain:
        assert not plain["numba_imported"]
        for name, plant in PLANTS[which]().items():
            # angles of some 10 rad after a thousand operations, each rounded at 1e-16
            assert plain[name] == pytest.approx(trajectory(plant), rel=1e-10, abs=1e-11), name


if __name__ == "__main__":
    found = {name: trajectory(plant) for name, plant in PLANTS[sys.argv[1]]().items()}
    np.savez(sys.argv[2], numba_imported="numba" in sys.modules, **found)
