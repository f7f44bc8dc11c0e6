"""The linear form of a vehicle at a trim as a state space of python-control."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from auv_gym.extra import needs
from auv_gym.models.linear.linearise import linearise
from auv_gym.plant import Plant
from auv_gym.writing import replacing


def control_system(
    plant: Plant,
    inputs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    *,
    continuous: bool = False,
    **settings: Any,
) -> Any:
    """A vehicle linearised at steady motion, as a `control.StateSpace` with named states, inputs and outputs.

    All of them are deviations from the trim.  continuous: return the continuous-time system whose response to held
    inputs equals that of the sampled one.  inputs, outputs, settings: see `auv_gym.models.linear.linearise`.

    Example:

        >>> from auv_gym import load_vehicle
        >>> from auv_gym.exports import control_system
        >>> system = control_system(load_vehicle("slocum"))
        >>> system.input_labels, system.nstates
        (['rudder_rad'], 2)
    """
    with needs("A python-control system needs control", "control"):
        import_module("control")
    sampled = linearise(plant, inputs, outputs, **settings).to_control()
    if not continuous:
        return sampled
    from scipy.linalg import logm

    n, m = sampled.B.shape
    rates: Any = np.real(logm(np.block([[sampled.A, sampled.B], [np.zeros((m, n)), np.eye(m)]]))) / sampled.dt
    names = {"states": sampled.state_labels, "inputs": sampled.input_labels, "outputs": sampled.output_labels}
    return type(sampled)(rates[:n, :n], rates[:n, n:], sampled.C, sampled.D, 0, **names)


def save_system(system: Any, file: Path) -> None:
    """Write a, b, c, d, dt and the names of a system to a MAT file, which scipy, MATLAB and Octave read."""
    from scipy.io import savemat

    names = {"states": system.state_labels, "inputs": system.input_labels, "outputs": system.output_labels}
    cells = {key: np.array(labels, dtype=object) for key, labels in names.items()}
    with replacing(file) as new, new.open("wb") as stream:
        savemat(stream, {"a": system.A, "b": system.B, "c": system.C, "d": system.D, "dt": system.dt, **cells})
