"""Scenarios of policies trained on models: four vehicles, each with an undeclared effect."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import radians
from pathlib import Path
from typing import Any

import gymnasium

from auv_gym.model import Model
from auv_gym.param import list_paths, replace_at, value_at
from auv_gym.plant import Plant, load_vehicle
from auv_gym.rl.settings import TRUE as ITSELF, make_env
from identification.experiments.manoeuvres import NOISE

TRUE, BELIEVED, DIAGNOSED, RANDOMISED = "true", "believed", "diagnosed", "randomised"
STACKED, RECURRENT = "stacked", "recurrent"  # with domain randomisation, too
ARMAX, GREY_BOX, HULL = "armax", "grey_box", "ls_svm"
CONTROLLERS = ("pid", "s_plane", "gpc")
WORDS = {
    TRUE: "(a) the true vehicle",
    ARMAX: "(b) ARMAX",
    GREY_BOX: "(b) grey box",
    HULL: "(b) LS-SVM hull",
    BELIEVED: "(c) the believed vehicle",
    DIAGNOSED: "(d) the diagnosed vehicle",
    RANDOMISED: "(e) domain randomisation",
    STACKED: "(e) and 8 stacked frames",
    RECURRENT: "(e) and recurrent PPO",
    "pid": "PID",
    "s_plane": "S-plane",
    "gpc": "GPC",
}
REMEMBERING: Mapping[str, Mapping[str, Any]] = {RANDOMISED: {}, STACKED: {"frames": 8}, RECURRENT: {"recurrent": True}}
SPREAD = 0.2  # relative range of a coefficient to either side, in domain randomisation


@dataclass(frozen=True)
class Scenario:
    """A vehicle with an undeclared effect in an environment; name: in cases and folders.

    effect: path and value.  options: of the environment, without the vehicle.  log: settings of the experiment.
    linear: orders of ARMAX.  free: coefficients of the grey box.  window, settle: s, of its free runs and those of the
    diagnosis, None for the vehicle's own.  drawn: ranges of domain randomisation beside those of `coefficients`.
    channel, command: shown in pictures of episodes.  gamma: of the learning; steps: of one training.  shipped: whether
    policies learn with the environment's own hyperparameters.  conditions: ranges of quantities outside the vehicle,
    such as a current, drawn in every episode, in training and in the tests.
    """

    name: str
    title: str
    env: str
    vehicle: str
    dt: float
    effect: tuple[str, float]
    options: Mapping[str, Any]
    log: Mapping[str, Any]
    linear: Mapping[str, Any]
    free: tuple[str, ...]
    drawn: Mapping[str, tuple[float, float]]
    coefficients: tuple[str, ...]
    rows: tuple[str, ...]
    controllers: tuple[str, ...]
    channel: str
    command: str
    gamma: float
    steps: int
    window: float | None = None
    settle: float | None = None
    shipped: bool = False
    conditions: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def believed(self) -> Plant:
        """The vehicle that its modeller believes in."""
        return load_vehicle(self.vehicle, dt=self.dt)

    @property
    def truth(self) -> Plant:
        """The true vehicle."""
        return replace_at(self.believed, dict([self.effect]))

    @property
    def ranges(self) -> dict[str, tuple[float, float]]:
        """The ranges of domain randomisation, by parameter path."""
        plant = self.believed
        own = {path: value_at(plant, path) for path in self.coefficients}
        wide = {path: sorted((value * (1.0 - SPREAD), value * (1.0 + SPREAD))) for path, value in own.items()}
        return {**self.conditions, **self.drawn, **{path: (low, high) for path, (low, high) in wide.items()}}

    @property
    def settings(self) -> dict[str, Any]:
        """All options of the environment of the believed vehicle."""
        drawn = {"randomise": {path: list(limits) for path, limits in self.conditions.items()}}
        return {"vehicle": self.vehicle, "dt": self.dt, **self.options, **(drawn if self.conditions else {})}

    def driven_by(self, model: Model) -> tuple[str | Model, dict[str, Any]]:
        """The replacement of the vehicle in the environment, and the environment's options.

        Drawn conditions do not act on a replacing model.  With conditions, a plant is therefore given by those of its
        parameters that differ from the believed vehicle's; raises for other models.
        """
        if not self.conditions:
            return model, self.settings
        if not isinstance(model, Plant) or model.learned is not None:
            raise ValueError(
                f"Episodes of {self.name} draw {', '.join(self.conditions)}, which act on a plant without a learned "
                f"part, got {type(model).__name__}: leave out this row."
            )
        believed = self.believed
        changed = {p: value_at(model, p) for p in list_paths(model) if value_at(model, p) != value_at(believed, p)}
        changed = {path: value for path, value in changed.items() if path not in self.conditions}
        return ITSELF, {**self.settings, "effects": {**self.options.get("effects", {}), **changed}}

    @property
    def all_rows(self) -> tuple[str, ...]:
        """The trained rows, then the controllers."""
        return (*self.rows, *self.controllers)


PPO: Mapping[str, Any] = {
    "n_envs": 32,
    "normalize": True,
    "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -1.0},
    "n_steps": 64,
    "batch_size": 512,
    "n_epochs": 10,
    "learning_rate": "lin_1e-3",
    "gae_lambda": 0.95,
    "clip_range": 0.2,
}
_SENSORS = {**NOISE, "compass": radians(0.5), "depth": 0.02}
_CURRENTS = ("effects.current.north", "effects.current.east")
_SCENARIOS = (
    Scenario(
        name="glider",
        title="GliderHeading-v0, slocum, a constant yaw moment of 0.007 N m",
        env="auv_gym/GliderHeading-v0",
        vehicle="slocum",
        dt=4.0,
        effect=("effects.yaw.moment", 0.007),
        options={"compass_noise": radians(0.5)},
        log={"duration": 2400.0},
        linear={"outputs": ("heading_rad",), "n_a": 2, "n_b": 2, "n_c": 2, "integrating": ("heading_rad",)},
        free=("hull.n_r", "hull.n_delta"),
        drawn={"effects.yaw.moment": (-0.01, 0.01), "effects.rudder.offset": (-0.05, 0.05)},
        coefficients=("hull.n_r", "hull.n_delta"),
        rows=(TRUE, BELIEVED, DIAGNOSED, ARMAX, GREY_BOX, RANDOMISED, STACKED, RECURRENT),
        controllers=("pid", "gpc"),
        channel="heading_rad",
        command="rudder_rad",
        gamma=0.98,
        steps=80_000,
    ),
    Scenario(
        name="torpedo",
        title="Heading-v0, heu_torpedo, a rudder that lags by 1.5 s",
        env="auv_gym/Heading-v0",
        vehicle="heu_torpedo",
        dt=0.2,
        effect=("effects.rudder.lag", 1.5),
        options={"effects": {f"effects.sampling.{sensor}.noise": value for sensor, value in _SENSORS.items()}},
        log={"duration": 400.0},
        linear={
            "outputs": ("heading_rad", "r_radps", "v_mps", "roll_rad", "u_mps"),
            "n_a": 2,
            "n_b": 2,
            "n_c": 2,
            "integrating": ("heading_rad",),
        },
        free=("hull.sway.uv", "hull.yaw.uv", "hull.yaw.ur", "parts.rudder.moment"),
        drawn={
            "effects.rudder.lag": (0.0, 2.0),
            "effects.rudder.dead_time": (0.0, 1.0),
            "effects.rudder.gain": (0.8, 1.2),
            "effects.rudder.offset": (-0.05, 0.05),
        },
        coefficients=("hull.sway.uv", "hull.yaw.uv", "hull.yaw.ur"),
        rows=(TRUE, BELIEVED, DIAGNOSED, ARMAX, GREY_BOX, HULL, RANDOMISED, STACKED, RECURRENT),
        controllers=CONTROLLERS,
        channel="heading_rad",
        command="rudder_rad",
        gamma=0.98,
        steps=100_000,
        window=25.0,
        settle=5.0,
    ),
    Scenario(
        name="rov",
        title="StationKeeping-v0, bluerov2_heavy, readings that come 0.2 s late",
        env="auv_gym/StationKeeping-v0",
        vehicle="bluerov2_heavy",
        dt=0.05,
        effect=("effects.clock.delay", 0.2),
        options={"actions": ["surge", "sway", "heave", "yaw"]},
        log={"duration": 120.0},
        linear={},
        free=(),
        drawn={
            "effects.clock.delay": (0.0, 0.3),
            **{f"effects.t{k}.gain": (0.8, 1.2) for k in range(1, 9)},
        },
        coefficients=("hull.surge.u_u", "hull.sway.v_v", "hull.heave.w_w", "hull.yaw.r_r"),
        rows=(TRUE, BELIEVED, DIAGNOSED, RANDOMISED, STACKED),
        controllers=("pid", "gpc"),
        channel="north_m",
        command="t1_share",
        gamma=0.99,
        steps=4_000_000,
        window=5.0,  # runs of the believed vehicle over 20 s diverge in two of five logs
        settle=1.0,
        shipped=True,
        conditions=dict.fromkeys(_CURRENTS, (-0.22, 0.22)),
    ),
    Scenario(
        name="flight",
        title="Glide-v0, seaglider, growth that adds 30 % to its drag",
        env="auv_gym/Glide-v0",
        vehicle="seaglider",
        dt=30.0,
        effect=("effects.polar.growth", 0.3),
        options={},
        log={},
        linear={},
        free=(),
        drawn={"effects.polar.growth": (0.0, 0.6), "effects.volume.offset": (-3e-5, 3e-5)},
        coefficients=("hull.drag_0", "hull.drag_2", "hull.lift_1"),
        rows=(TRUE, BELIEVED, DIAGNOSED, RANDOMISED),
        controllers=("pid",),
        channel="north_m",
        command="buoyancy_volume_m3",
        gamma=0.995,
        steps=600_000,
        shipped=True,
        conditions=dict.fromkeys(_CURRENTS, (-0.117, 0.117)),
    ),
)
SCENARIOS: Mapping[str, Scenario] = {scenario.name: scenario for scenario in _SCENARIOS}


def case_of(name: str, row: str) -> str:
    """The case of the study for a row of a scenario."""
    return f"{name}, {row}"


def split_case(case: str) -> tuple[str, str]:
    """The names of scenario and row."""
    name, _, row = case.partition(", ")
    return name, row


def policy_folder(name: str, row: str, seed: int, out: Path) -> Path:
    """The folder of a training's files."""
    return out / name / row / f"seed_{seed}"


def true_env(scenario: Scenario) -> gymnasium.Env:
    """The environment for judging all rows: the true vehicle with noisy sensors.

    Scales, limits and the controller's knowledge are those of the believed vehicle, as an operator would have them.
    """
    on, options = scenario.driven_by(scenario.truth)
    return make_env(scenario.env, on, **options)
