"""Models of the torpedo AUV from noisy records, each judged on held-out circles and dives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from typing import Any

from auv_gym.model import Diverged, Model, simulate
from auv_gym.models.spliced import splice
from auv_gym.plant import Plant
from auv_gym.records.record import Record
from identification.fit.greybox import GreyBox
from identification.kernel_machines.hull.hull import HullLsSvm
from identification.linear.polynomials.arx import Arx
from identification.linear.subspaces.n4sid import N4sid
from scripts.reproduce.ls_svm.experiments import MANOEUVRES, NOISE, Judgement, bang_bang_runs, circled, judged, vehicle
from scripts.studies.identified_rollouts import off

ONE_VOLTAGE, SEVERAL = (4.0,), (3.0, 3.5, 4.0, 4.5, 5.0)  # V
DATA = {"4 V": ONE_VOLTAGE, "3 to 5 V": SEVERAL}
STEP = 0.1  # s, of the models' integration, the sample time: the vehicle's own is 0.02 s, with the same result to 1e-5
MOTION = ("u_mps", "v_mps", "w_mps", "p_radps", "q_radps", "r_radps", "roll_rad", "pitch_rad")
FREE = (  # moved by the bang-bang; in the true structure, which only a grey box knows
    *("hull.surge.u_u", "hull.sway.uv", "hull.sway.ur", "hull.sway.v_v", "hull.heave.uw", "hull.heave.uq"),
    *("hull.heave.w_w", "hull.roll.up", "hull.pitch.uw", "hull.pitch.uq", "hull.yaw.uv", "hull.yaw.ur"),
)
SHARES = (0.8, 1.2)  # initial values of the grey box over the true ones, alternating
WINDOW = 12.0  # s, of its free runs
GIVEN = "coefficients off by 20 %"


def methods(voltages: Sequence[float]) -> dict[str, object]:
    """Estimators by name, for records at these voltages."""
    coarse = replace(vehicle(), longest_step=STEP)
    wrong = off(coarse, FREE, SHARES)
    fins = ("rudder_rad", "stern_plane_rad")
    # one lag of the voltage, which is constant in each run, so more are collinear; subspaces cannot use it at all
    several = len(voltages) > 1
    commands, lags = ((*fins, "propeller_V"), [[2, 2, 1]] * len(MOTION)) if several else (fins, 2)
    return {
        "LS-SVM": HullLsSvm(coarse),
        "LS-SVM, 256 centres": HullLsSvm(coarse, size=256),
        "LS-SVM with a trend, 256 centres": HullLsSvm(coarse, size=256, trend=True),
        "grey box": GreyBox(wrong, FREE, window=WINDOW),
        "ARX": Arx(commands, MOTION, n_a=2, n_b=lags, structure="full"),
        "N4SID": N4sid(fins, MOTION),
    }


def judged_methods(data: str, seed: int) -> list[dict]:
    """A row for each method and manoeuvre of one seed; the row of a failed method gives the reason."""
    records = bang_bang_runs(DATA[data], seed, noise=NOISE)
    rows = [row for name, made in methods(DATA[data]).items() for row in _judged(data, seed, name, made, records)]
    return rows + _rows(data, seed, GIVEN, off(replace(vehicle(), longest_step=STEP), FREE, SHARES))


def run_of(model: Model, true: Record) -> Record:
    """A model's run with the commands of a manoeuvre, from the start of the vehicle's own."""
    if isinstance(model, Plant):
        return simulate(model, true)
    whole: Any = splice(vehicle(), model)
    return simulate(whole, true)


def _judged(data: str, seed: int, name: str, estimator, records: Sequence[Record]) -> list[dict]:
    try:
        model = estimator.fit(*records).model
    except ValueError as error:
        return [{"data": data, "seed": seed, "method": name, "failed": str(error)}]
    return _rows(data, seed, name, model)


def _rows(data: str, seed: int, name: str, model: Model) -> list[dict]:
    rows = []
    for manoeuvre in MANOEUVRES:
        true = circled(manoeuvre)
        row = {"data": data, "seed": seed, "method": name, "manoeuvre": manoeuvre.title}
        try:
            run = run_of(model, true)
            found: Judgement = judged(true, run, model if isinstance(model, Plant) else None)
            rows.append(row | {key: float(value) for key, value in asdict(found).items()})
        except Diverged:
            rows.append(row | {"failed": f"diverged in {manoeuvre.title}"})
    return rows
