"""How often the 95 % intervals of linear fits contain the truth, over many records of known systems.

    python -m scripts.studies.coverage --seeds 500 --samples 1000 --jobs 2 --out coverage

Each method has the orders of its system. The study counts the share of records in which each interval contains the true
value. The intervals are those of the coefficients and, for the refined state space, those of the poles and of gain and
phase of the responses.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.signal import lfilter

from auv_gym.model import Diverged
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.records.record import Record
from identification.experiments.excitation import prbs
from identification.linear.fit import LinearFit
from identification.linear.poles import pole_intervals
from identification.linear.polynomials.armax import Armax
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.output_error import OutputError
from identification.linear.polynomials.polynomial_fit import PolynomialFit
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.uncertainty import response_band
from scripts.benchmarks.systems import ARMAX, DT, STATE_SPACE, measured
from scripts.studies.harness import Found, Option, Sheet, Study

LOW, HIGH = 90.0, 99.0  # %, acceptable coverage of 95 % intervals
OMEGA = (0.1, 0.5, 1.5)  # rad/s, frequencies of the judged responses
NOISE = 0.10  # standard deviation of a disturbance over that of the clean output
SETTLING = 200  # samples before a record begins
INPUTS, OUTPUTS = ("rudder_rad", "stern_plane_rad"), ("r_radps", "q_radps")
# A and C with all outputs in each equation, poles 0.83, 0.62 and 0.73 +- 0.28j
COUPLED = Polynomial(
    a=[[[1.0, 0.0], [0.0, 1.0]], [[-1.5, 0.2], [-0.1, -1.4]], [[0.6, -0.1], [0.1, 0.5]]],  # type: ignore[arg-type]
    b=[[[0.0, 0.0], [0.0, 0.0]], [[0.5, 0.1], [-0.2, 0.4]], [[0.2, -0.1], [0.1, 0.3]]],  # type: ignore[arg-type]
    c=[[[1.0, 0.0], [0.0, 1.0]], [[-0.4, 0.1], [0.15, 0.3]]],  # type: ignore[arg-type]
    inputs=INPUTS,
    outputs=OUTPUTS,
    dt=DT,
)


@dataclass(frozen=True)
class Case:
    """A method, records of a system with the same orders, and the true values of the judged quantities.

    judged: from a fit to its intervals, by name.  true: by name.
    """

    record: Callable[[int, int], Record]
    method: Any
    judged: Callable[[Any], dict[str, tuple[float, float]]]
    true: Mapping[str, float]


def attempt(case: str, seed: int, samples: int) -> dict[str, bool] | None:
    """Whether each interval of a fit to one record includes the truth, by name; None if the record is refused."""
    this = CASES[case]
    try:
        intervals = this.judged(this.method.fit(this.record(samples, seed)))
    except (ValueError, Diverged):
        return None
    return {name: bool(low <= this.true[name] <= high) for name, (low, high) in intervals.items()}


def disturbed(true: Polynomial, hold: int, samples: int, seed: int) -> Record:
    """A record of a polynomial model driven by a PRBS at each input, with a disturbance of NOISE times its response.

    The disturbance is white noise through C and A, stationary from the first sample on.
    """
    rng, size = np.random.default_rng(seed), samples + SETTLING
    u = np.stack([prbs(size, hold, 1.0, rng) for _ in true.inputs], axis=1)
    e = rng.standard_normal((size, len(true.outputs)))
    system = true.state_space
    reply, disturbance = (
        _driven(system.a, u @ system.b.T) @ system.c.T,
        e + _driven(system.a, e @ system.k.T) @ system.c.T,
    )
    y = reply + NOISE * reply.std(axis=0).mean() / disturbance.std(axis=0).mean() * disturbance
    columns = dict(zip((*true.inputs, *true.outputs), np.hstack([u, y])[SETTLING:].T))
    return Record.from_arrays(DT * np.arange(samples), columns)


def coefficients(true: Polynomial) -> dict[str, float]:
    """True values of a polynomial model's coefficients by the names in fits."""
    named = {}
    for letter, array, others in (("a", true.a, true.outputs), ("b", true.b, true.inputs), ("c", true.c, true.outputs)):
        for power in range(1, len(array)):
            for i, output in enumerate(true.outputs):
                for j, other in enumerate(others):
                    named[f"{letter}{power}[{output}, {other}]"] = float(array[power, i, j])
                    if output == other:
                        named[f"{letter}{power}[{output}]"] = float(array[power, i, j])
    return named


def responses(model: Polynomial | StateSpace) -> dict[str, float]:
    """Poles, and gain and phase at OMEGA, of a model, by name."""
    system = model.state_space if isinstance(model, Polynomial) else model
    named = {}
    poles = system.poles()
    for number, pole in enumerate(poles[np.imag(poles) >= 0.0], start=1):
        named |= {f"pole {number} (real)": float(pole.real)}
        named |= {f"pole {number} (imaginary)": float(pole.imag)} if pole.imag > 0.0 else {}
    found = system.frequency_response(np.array(OMEGA))
    for at, i, j in np.ndindex(found.shape):
        where = f"[{system.outputs[i]}, {system.inputs[j]}] at {OMEGA[at]:g} rad/s"
        named |= {f"gain{where}": float(abs(found[at, i, j])), f"phase{where}": float(np.angle(found[at, i, j]))}
    return named


def _coefficient_intervals(true: Mapping[str, float]) -> Callable[[PolynomialFit], dict[str, tuple[float, float]]]:
    def judged(fit: PolynomialFit) -> dict[str, tuple[float, float]]:
        return {of.path: of.ci95 for of in fit.estimates if of.path in true}

    return judged


def _response_intervals(true: StateSpace) -> Callable[[LinearFit], dict[str, tuple[float, float]]]:
    """Intervals of poles, each named by the nearest true one, and of responses."""
    poles = true.poles()
    poles = poles[np.imag(poles) >= 0.0]

    def judged(fit: LinearFit) -> dict[str, tuple[float, float]]:
        found = pole_intervals(fit)
        apart = np.abs(poles[:, None] - np.array([pole.value for pole in found]))
        named: dict[str, tuple[float, float]] = {}
        for at, number in zip(*linear_sum_assignment(apart)):
            named[f"pole {at + 1} (real)"] = found[number].real.ci95
            if np.imag(poles[at]) > 0.0:
                named[f"pole {at + 1} (imaginary)"] = found[number].imaginary.ci95
        band = response_band(fit, OMEGA)
        true_phase = np.angle(true.frequency_response(np.array(OMEGA)))
        turns = 2.0 * np.pi * np.round((true_phase - band.phase) / (2.0 * np.pi))
        for words, (low, high) in (("gain", band.gain_bounds), ("phase", tuple(turns + b for b in band.phase_bounds))):
            for at, i, j in np.ndindex(low.shape):
                where = f"{words}[{true.outputs[i]}, {true.inputs[j]}] at {OMEGA[at]:g} rad/s"
                named[where] = (float(low[at, i, j]), float(high[at, i, j]))
        return named

    return judged


def _driven(a: np.ndarray, added: np.ndarray) -> np.ndarray:
    """States from rest, (samples, n), driven by the additions in every sample: by modes, each a filter."""
    poles, modes = np.linalg.eig(a)
    forced = added @ np.linalg.inv(modes).T
    run = np.stack([lfilter([0.0, 1.0], [1.0, -pole], column) for pole, column in zip(poles, forced.T)], axis=1)
    return np.real(run @ modes.T)


def _polynomial_case(true: Polynomial, hold: int, method: Any) -> Case:
    named = coefficients(true)
    return Case(
        lambda samples, seed: disturbed(true, hold, samples, seed), method, _coefficient_intervals(named), named
    )


def _with(c: np.ndarray) -> Polynomial:
    """The ARMAX system with another C."""
    return Polynomial(ARMAX.a, ARMAX.b, ARMAX.inputs, ARMAX.outputs, DT, c=c)


_ONE: dict[str, Any] = {"inputs": ARMAX.inputs, "outputs": ARMAX.outputs, "n_a": 4, "n_b": 4}
_TWO: dict[str, Any] = {"inputs": INPUTS, "outputs": OUTPUTS}
CASES: Mapping[str, Case] = {
    "armax": _polynomial_case(ARMAX, 2, Armax(**_ONE, n_c=2)),
    "arx": _polynomial_case(_with(np.eye(1)[None]), 2, Arx(**_ONE)),
    "output error": _polynomial_case(_with(ARMAX.a), 2, OutputError(**_ONE)),
    "armax, full 2 x 2": _polynomial_case(COUPLED, 2, Armax(**_TWO, n_a=2, n_b=2, n_c=1, structure="full")),
    "state space, refined": Case(
        lambda samples, seed: measured("state_space", samples, seed).record,
        N4sid(**_TWO, order=3, refine=True),
        _response_intervals(STATE_SPACE),
        responses(STATE_SPACE),
    ),
}


def shares_of(held: Sequence[dict[str, bool] | None]) -> dict[str, float]:
    """The share of records, %, whose interval includes the truth, by name."""
    good = [of for of in held if of is not None]
    names = dict.fromkeys(name for of in good for name in of)
    return {name: 100.0 * float(np.mean([of[name] for of in good if name in of])) for name in names}


def outside(found: Found) -> dict[tuple[str, str], float]:
    """The shares, %, outside of LOW to HIGH, by case and name."""
    by_case = {case: shares_of(found.of(case)) for case in found.runs}
    return {(case, n): share for case, of in by_case.items() for n, share in of.items() if not LOW <= share <= HIGH}


def sheets(found: Found) -> list[Sheet]:
    """A row for each case; in a file, the share of each interval."""
    rows, every, beyond = [], [], outside(found)
    for case in found.runs:
        held = found.of(case)
        shares, refused = shares_of(held), held.count(None)
        every += [[case, name, f"{share:.2f}"] for name, share in shares.items()]
        row = [case, str(len(held) - refused), str(refused)]
        if shares:
            least = min(shares, key=shares.__getitem__)
            ends = (f"{value:.1f}" for value in (np.mean(list(shares.values())), max(shares.values())))
            row += [str(len(shares)), f"{shares[least]:.1f}", least, *ends, str(sum(of == case for of, _ in beyond))]
        rows.append(row)
    heads = ("fit", "seeds>", "refused>", "intervals>", "least, %>", "of", "mean, %>", "most, %>")
    title = f"Share of 95 % intervals that hold the truth, {found.options['samples']} samples"
    return [
        Sheet("coverage", title, (*heads, f"outside {LOW:g} to {HIGH:g} %>"), rows),
        Sheet("intervals", "Share of records, %, by interval", ("fit", "interval", "share"), every, printed=False),
    ]


STUDY = Study(
    __doc__ or "",
    attempt,
    tuple(CASES),
    sheets,
    seeds=500,
    options={"samples": Option(1000, "of each record", least=1)},
    remarks=lambda found: [
        f"{case}: the interval of {name} holds the truth in {share:.1f} % of records"
        for (case, name), share in outside(found).items()
    ],
    good=lambda found: not outside(found),
    doing="records",
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
