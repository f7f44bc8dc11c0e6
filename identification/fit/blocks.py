"""Rows of windows arranged as one block for each window, and the damped step that eliminates the windows' starts."""

from __future__ import annotations

import numpy as np


class Blocks:
    """Rows of consecutive windows, as blocks as long as the longest window.

    lengths: (W,), rows of each window.  channels: C, values in each row.
    """

    def __init__(self, lengths: np.ndarray, channels: int):
        self.longest, self.channels = int(lengths.max()), channels
        self._filled = np.arange(self.longest) < lengths[:, None]
        self._even = bool(self._filled.all())

    def of(self, values: np.ndarray) -> np.ndarray:
        """Values (n, rows, C) as (W, n, L * C), zero past the end of shorter windows."""
        windows, count = len(self._filled), len(values)
        if self._even:
            parts = values.reshape(count, windows, self.longest, self.channels)
        else:
            parts = np.zeros((count, windows, self.longest, self.channels))
            parts[:, self._filled] = values
        return parts.transpose(1, 0, 2, 3).reshape(windows, count, self.longest * self.channels)

    def rows(self, parts: np.ndarray) -> np.ndarray:
        """Values (W, n, L * C) as (n, rows, C)."""
        parts = parts.reshape(*parts.shape[:2], self.longest, self.channels)
        return parts.transpose(1, 0, 2, 3)[:, self._filled]

    def normal(self, starts: np.ndarray, flat: np.ndarray, residual: np.ndarray | None):
        """Per window: normal matrix of the starts (W, F, F), cross terms (W, F, P) and gradient (W, F).

        starts: (F, rows, C), slopes by the windows' starts.  flat: (P, rows, C), slopes by the parameters.
        residual: (rows, C); with None, the gradient is None.
        """
        own = self.of(starts)
        gram = own @ own.transpose(0, 2, 1)
        gram += 1e-12 * np.eye(gram.shape[1]) * np.maximum(np.einsum("wff->w", gram), 1e-12)[:, None, None]
        cross = own @ self.of(flat).transpose(0, 2, 1)
        gradient = None if residual is None else (own @ self.of(residual[None]).transpose(0, 2, 1))[:, :, 0]
        return gram, cross, gradient


def block_step(normal, gradient, gram, cross, start_gradient, damping):
    """Damped Gauss-Newton step of the parameters (P,) and the starts (W, F), with the starts eliminated."""
    gram = gram + damping * np.einsum("wff->wf", gram)[:, :, None] * np.eye(gram.shape[1])
    inner = np.asarray(np.linalg.solve(gram, np.concatenate([cross, start_gradient[:, :, None]], axis=2)))
    gain, offset = inner[..., :-1], inner[..., -1]
    count = len(gradient)
    if count == 0:
        return np.zeros(0), offset
    schur = normal - np.einsum("wfp,wfq->pq", cross, gain) + damping * np.diag(np.diag(normal) + 1e-30)
    right = gradient - np.einsum("wfp,wf->p", cross, offset)
    change = np.linalg.lstsq(schur, right, rcond=1e-14)[0]
    return change, offset - gain @ change
