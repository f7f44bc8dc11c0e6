"""Linear systems whose coefficients are known, and records of them."""

from dataclasses import replace

import numpy as np

from auv_gym.models.linear import Polynomial
from auv_gym.records.record import Record
from identification.experiments.excitation import prbs

INPUTS, OUTPUTS = ("bow_plane_rad", "stern_plane_rad"), ("depth_m", "pitch_rad")
# the form of paper 1: depth of third order with an integrator, pitch of second order, two inputs
TRUTH = Polynomial.from_coefficients(
    a={"depth_m": [-2.5, 2.06, -0.56], "pitch_rad": [-1.5, 0.7]},
    b={
        "depth_m": {"bow_plane_rad": [-0.3, 0.1], "stern_plane_rad": [0.5, 0.2]},
        "pitch_rad": {"bow_plane_rad": [0.2, 0.05], "stern_plane_rad": [-0.4, -0.1]},
    },
    dt=4.0,
    inputs=INPUTS,
)
MOVED = replace(TRUTH, input_offset=np.array([0.03, -0.05]), output_offset=np.array([20.0, 0.1]))


def record_of(model, n, rng, noise=0.0, segments=1, start=0.0):
    """A record of the difference equation itself, with a white error of this standard deviation in each output."""
    size = n // segments
    labels = np.repeat(np.arange(segments), size)
    u = np.stack([prbs(labels.size, 2, 0.1, rng) for _ in model.inputs], axis=1) + model.input_offset
    y = np.zeros((labels.size, len(model.outputs)))
    for s in range(segments):
        past = np.full((size, len(model.outputs)), start * rng.standard_normal())
        for k in range(size):
            row = noise * rng.standard_normal(len(model.outputs))
            for j in range(1, len(model.a)):
                row -= model.a[j] @ past[k - j] if k >= j else 0.0
            for j in range(1, len(model.b)):
                row += model.b[j] @ (u[s * size + k - j] - model.input_offset) if k >= j else 0.0
            past[k] = row
        y[labels == s] = past + model.output_offset
    columns = dict(zip((*model.inputs, *model.outputs), np.concatenate([u, y], axis=1).T))
    return Record.from_arrays(model.dt * np.arange(labels.size), columns, labels)
