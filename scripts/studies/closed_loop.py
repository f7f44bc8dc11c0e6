"""Which methods are biased by feedback: pitch under a PID, PRBS at the plane, a coloured disturbance, many seeds.

    python -m scripts.studies.closed_loop --seeds 50 --jobs 2 --out closed_loop

The truth is the pitch of a torpedo's linear form, so that its poles and its response are known. Each seed gives one
record in closed loop and one in open loop. Every method fits the first part of each and all of it, with the right
orders. A bias is a mean error over the seeds that is significantly larger than 1 % of a response, or 0.01 of a pole.
With more samples a bias remains, while the scatter shrinks. An unstable vehicle has no open loop.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import stats
from scipy.optimize import linear_sum_assignment

from auv_gym.model import Diverged
from auv_gym.models.linear import Polynomial, StateSpace, linearise
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from controllers.gains import gains_for
from controllers.pid import Pid
from identification.estimator import Estimator
from identification.experiments.excitation import prbs
from identification.linear.polynomials.armax import Armax
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.output_error import OutputError
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.subspaces.pbsid import Pbsid
from scripts.studies.harness import Found, Option, Sheet, Study

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VEHICLE, DT = "heu_torpedo", 0.5  # s
PLANE, PITCH = "stern_plane_rad", "pitch_rad"
STATES = ("w_mps", "q_radps", PITCH)
ORDER = len(STATES)
COLOUR = (1.0, 0.5)  # C of the disturbance C(q) / A(q) e on the pitch, e white; A has the vehicle's poles
NOISE, EXCITATION = 0.002, 0.05  # rad: standard deviation of that white noise; amplitude of the PRBS
HOLD = 2  # samples of the PRBS
RUN_IN = 200  # samples before a record begins
OMEGA = (0.1, 0.3, 1.0, 3.0)  # rad/s, at which responses are judged
LOOPS = ("closed", "open")
CHANCE = 0.01  # probability that an unbiased method is called biased, over all quantities together
MATTERS = 0.01  # least relevant bias of a pole, and of a response relative to it
_GAINS_AT = 0.1  # s, sample time for which the vehicle's gains were tuned
_LOST = 10.0  # rad, a pitch that is out of control
_SPREAD = (5.0, 95.0)  # percentiles of the figure
_COLUMNS = 4  # of the figure


@dataclass(frozen=True, eq=False)
class Errors:
    """The errors of a method in each seed: of poles, and of responses relative to the true one.

    values: (seeds, quantities), by `quantities`.  responses: those of the figure, (seeds, n).  refused: why records
    were not fitted.
    """

    values: np.ndarray
    responses: np.ndarray
    refused: tuple[str, ...] = ()

    @cached_property
    def bias(self) -> np.ndarray:
        return self.values.mean(axis=0)

    @cached_property
    def error(self) -> np.ndarray:
        """Standard error of the bias."""
        return self.values.std(axis=0, ddof=1) / np.sqrt(len(self.values))

    @cached_property
    def t(self) -> np.ndarray:
        """The bias over its standard error."""
        return self.bias / np.maximum(self.error, np.finfo(float).tiny)

    @cached_property
    def rms(self) -> np.ndarray:
        return np.sqrt(np.mean(self.values**2, axis=0))

    @property
    def enough(self) -> bool:
        """Whether there are enough seeds for an estimate of scatter."""
        return len(self.values) > 1

    @property
    def biased(self) -> bool:
        """Whether a mean error is significantly larger than MATTERS."""
        return bool((self.least > MATTERS).any())

    @cached_property
    def least(self) -> np.ndarray:
        """The significant size of each quantity's bias, all of them together; zero or below: perhaps none."""
        seeds, count = self.values.shape
        return np.abs(self.bias) - stats.t.ppf(1.0 - 0.5 * CHANCE / count, seeds - 1) * self.error


@lru_cache(maxsize=4)
def truth(vehicle: str = VEHICLE) -> Polynomial:
    """The pitch of a vehicle whose plane follows its command at once, and its disturbance, as ARMAX."""
    quick = {"parts.stern_plane.lag": 0.0, "parts.stern_plane.slowness": 0.0}
    form = linearise(replace_at(load_vehicle(vehicle), quick), [PLANE], [PITCH], states=STATES, dt=DT)
    a = np.real(np.poly(form.poles()))
    impulse = [(form.c @ np.linalg.matrix_power(form.a, k) @ form.b).item() for k in range(ORDER)]
    b = np.convolve(a, impulse)[:ORDER]
    return Polynomial.from_coefficients(
        {PITCH: a[1:].tolist()}, {PITCH: {PLANE: b.tolist()}}, DT, c={PITCH: COLOUR[1:]}
    )


def pitch_pid(vehicle: str = VEHICLE) -> Pid:
    """The vehicle's own pitch controller, with only the pitch as input and without limits: the loop is linear."""
    gains = gains_for(vehicle, _GAINS_AT).loops["pid"]["pitch"]
    return Pid(gains["proportional"], gains["integral"], gains["derivative"], measured=PITCH, command=PLANE)


def estimators() -> dict[str, Estimator]:
    """The methods, all with the orders of the truth."""
    told: dict[str, Any] = {"inputs": (PLANE,), "outputs": (PITCH,)}
    orders: dict[str, Any] = {"n_a": ORDER, "n_b": ORDER}
    return {
        "arx": Arx(**told, **orders),
        "output_error": OutputError(**told, **orders),
        "armax": Armax(**told, **orders, n_c=len(COLOUR) - 1),
        "n4sid": N4sid(**told, order=ORDER),
        "n4sid, refined": N4sid(**told, order=ORDER, refine=True),
        "pbsid": Pbsid(**told, order=ORDER),
        "pbsid, refined": Pbsid(**told, order=ORDER, refine=True),
    }


def simulated(seed: int, samples: int, loop: str = "closed", vehicle: str = VEHICLE) -> Record:
    """A record of pitch and plane; the same seed has the same PRBS and disturbance in either loop.

    Raises if the controller does not hold the pitch.
    """
    system, rng, pid = truth(vehicle).state_space, np.random.default_rng(seed), pitch_pid(vehicle)
    added = prbs(samples + RUN_IN, HOLD, EXCITATION, rng)
    noise = NOISE * rng.standard_normal(samples + RUN_IN)
    x, memory = np.zeros(len(system.states)), pid.start()
    pitch, plane = np.empty(noise.size), added.copy()
    b, c, k = system.b[:, 0], system.c[0], system.k[:, 0]
    for at, e in enumerate(noise):
        pitch[at] = c @ x + e
        if not abs(pitch[at]) < _LOST:
            raise ValueError(
                f"The gains of {vehicle!r}, tuned for {_GAINS_AT:g} s, do not hold its pitch at samples of {DT:g} s: "
                "choose another vehicle."
            )
        if loop == "closed":
            command, memory = pid.act(memory, {PITCH: float(pitch[at]), "dt_s": DT}, {PITCH: 0.0})
            plane[at] += command[PLANE]
        x = system.a @ x + b * plane[at] + k * e
    time = DT * np.arange(samples)
    return Record.from_arrays(time, {PITCH: pitch[RUN_IN:], PLANE: plane[RUN_IN:]})


def attempt(
    loop: str, seed: int, samples: Sequence[int] = (2000,), vehicle: str = VEHICLE, methods: Sequence[str] = ()
) -> dict[str, dict[str, Any]]:
    """The errors of each method for several lengths of one record, by samples, then by method.

    Values by `quantities` and responses by `bode_frequencies`, or why a method failed.  methods: by default all.
    """
    true = truth(vehicle)
    if loop == "open" and not true.state_space.is_stable():
        raise ValueError(f"The pitch of {vehicle!r} is unstable by itself: study it in closed loop alone.")
    record, found = simulated(seed, max(samples), loop, vehicle), {}
    for length in sorted(samples):
        part, by_method = record.select(np.arange(len(record)) < length), {}
        for name, method in estimators().items():
            if methods and name not in methods:
                continue
            try:
                model: Any = method.fit(part).model
                by_method[name] = {"values": _wrong(model, true), "responses": _off(model, true, bode_frequencies())}
            except (ValueError, Diverged) as error:
                by_method[name] = {"refused": str(error)}
        found[str(length)] = by_method
    return found


def errors_by_method(found: Found) -> dict[tuple[str, int], dict[str, Errors]]:
    """The errors of all seeds by loop and samples, then by method."""
    for loop, runs in found.runs.items():
        if len(runs) < 2:
            raise ValueError(f"Scatter needs --seeds of at least 2, got {len(runs)} in {loop} loop.")
    return {
        (loop, length): {name: _over_seeds([of[str(length)][name] for of in runs.values()]) for name in by_method}
        for loop, runs in found.runs.items()
        for length in sorted(found.options["samples"])
        for by_method in [next(iter(runs.values()))[str(length)]]
    }


def quantities(true: Polynomial) -> tuple[str, ...]:
    """Names of the judged quantities."""
    poles = _poles(true)
    named = []
    for number, pole in enumerate(poles[np.imag(poles) >= 0.0], start=1):
        named += [f"pole {number} (real)", f"pole {number} (imaginary)"] if pole.imag > 0.0 else [f"pole {number}"]
    return (*named, *(f"response at {at:g} rad/s ({part})" for part in ("real", "imaginary") for at in OMEGA))


def bode_frequencies() -> np.ndarray:
    """Frequencies of the figure, rad/s."""
    return np.geomspace(OMEGA[0], 0.9 * np.pi / DT, 40)


def refusals(found: Found) -> list[str]:
    """The number of records that were not fitted, by loop, length and method, and the first reason."""
    return [
        f"{loop} loop, {samples} samples, {method}: {len(errors.refused)} records refused ({errors.refused[0]})"
        for (loop, samples), by_method in errors_by_method(found).items()
        for method, errors in by_method.items()
        if errors.refused
    ]


def pictures(found: Found) -> dict[str, Callable[[], Figure]]:
    """A figure for each loop, from the longest records."""
    vehicle, most = found.options["vehicle"], max(found.options["samples"])
    return {
        f"{loop}_loop_{vehicle}.png": partial(response_figure, by_method, truth(vehicle), f"{loop} loop, {n} samples")
        for (loop, n), by_method in errors_by_method(found).items()
        if n == most
    }


def response_figure(by_method: Mapping[str, Errors], true: Polynomial, words: str) -> Figure:
    """Gain and phase by each method, mean and the band with 90 % of the seeds, over the true ones."""
    from identification.pages.drawing import AFTER, BEFORE, INK, grid, new_figure

    omega = bode_frequencies()
    response = true.state_space.frequency_response(omega)[:, 0, 0]
    shown = {method: errors for method, errors in by_method.items() if errors.enough}
    rows = (len(shown) + _COLUMNS - 1) // _COLUMNS
    figure = new_figure(4.2 * rows + 0.4)
    panels = np.reshape(grid(figure, 2 * rows * _COLUMNS, _COLUMNS), (rows, 2, _COLUMNS))
    for axes in panels.ravel():
        axes.set_axis_off()
    for number, (method, errors) in enumerate(shown.items()):
        gain, phase = panels[number // _COLUMNS, :, number % _COLUMNS]
        colour = BEFORE if errors.biased else AFTER
        turned = errors.responses + 1.0
        for axes, true_values, values in (
            (gain, 20.0 * np.log10(np.abs(response)), 20.0 * np.log10(np.maximum(np.abs(turned), 1e-6))),
            (phase, np.degrees(np.unwrap(np.angle(response))), np.degrees(np.unwrap(np.angle(turned), axis=1))),
        ):
            axes.set_axis_on()
            low, high = np.percentile(values, _SPREAD, axis=0)
            axes.fill_between(omega, true_values + low, true_values + high, color=colour, alpha=0.25, linewidth=0)
            axes.semilogx(omega, true_values + values.mean(axis=0), color=colour, linewidth=1.4, label=method)
            axes.semilogx(omega, true_values, color=INK, linewidth=1.0, linestyle=":", label="truth")
        gain.set_title(f"{method}: {'biased' if errors.biased else 'no bias seen'}", loc="left")
        if number % _COLUMNS == 0:
            gain.set_ylabel("gain, dB")
            phase.set_ylabel("phase, deg")
        phase.set_xlabel("frequency, rad/s")
    figure.suptitle(f"Pitch by plane, {words}: mean and 5 to 95 % of {_seeds(shown)} seeds; dotted: the truth")
    return figure


def _seeds(by_method: Mapping[str, Errors]) -> int:
    return max((len(errors.values) for errors in by_method.values()), default=0)


def _over_seeds(done: Sequence[Mapping[str, Any]]) -> Errors:
    good = [found for found in done if "values" in found]
    responses = np.array([np.array(found["responses"]) @ (1.0, 1.0j) for found in good])
    refused = tuple(found["refused"] for found in done if "refused" in found)
    return Errors(np.array([found["values"] for found in good]), responses, refused)


def _wrong(model: Polynomial | StateSpace, true: Polynomial) -> np.ndarray:
    """Errors of a model by `quantities`; poles are paired with the true ones for the least sum of distances."""
    poles, found = _poles(true), _poles(model)
    apart = np.abs(poles[:, None] - found)
    rows, columns = linear_sum_assignment(apart)
    off = np.full(poles.size, np.nan, dtype=complex)
    off[rows] = found[columns] - poles[rows]
    parts = []
    for error, pole in zip(off, poles):
        if pole.imag >= 0.0:
            parts += [error.real, error.imag] if pole.imag > 0.0 else [error.real]
    response = _off(model, true, np.array(OMEGA))
    return np.concatenate([parts, np.real(response), np.imag(response)])


def _off(model: Polynomial | StateSpace, true: Polynomial, omega: np.ndarray) -> np.ndarray:
    """Error of a model's response relative to the true one, complex."""
    found, wanted = (
        (of.state_space if isinstance(of, Polynomial) else of).frequency_response(omega)[:, 0, 0]
        for of in (model, true)
    )
    return found / wanted - 1.0


def _poles(model: Polynomial | StateSpace) -> np.ndarray:
    return (model.state_space if isinstance(model, Polynomial) else model).poles()


def _worst(errors: Errors, inside: Sequence[int]) -> int:
    """Among these quantities, the index of the one with the most significant bias."""
    return inside[int(np.argmax(np.abs(errors.t[list(inside)])))]


def sheets(found: Found) -> list[Sheet]:
    """A table for each loop and length of the records; in a file, all quantities."""
    shown, every = [], []
    names = quantities(truth(found.options["vehicle"]))
    for (loop, samples), by_method in errors_by_method(found).items():
        rows = [_row(method, errors, names) for method, errors in by_method.items()]
        title = f"{loop.capitalize()} loop, {samples} samples, {_seeds(by_method)} seeds: mean errors and how sure"
        shown.append(Sheet(f"{loop}_{samples}", title, _HEADS, rows))
        for method, errors in by_method.items():
            columns = (errors.bias, errors.error, errors.t, errors.rms) if errors.enough else ()
            for name, *numbers in zip(names, *columns):
                every.append([loop, str(samples), method, name, *(f"{number:.6g}" for number in numbers)])
    heads = ("loop", "samples", "method", "quantity", "bias", "standard error", "t", "rms")
    return [*shown, Sheet("quantities", "All quantities", heads, every, printed=False)]


_HEADS = (
    *("method!", "pole worst off!", "bias>", "t>", "rms>"),
    *("response worst off!", "bias, %>", "t>", "rms, %>", "bias"),
)


def _row(method: str, errors: Errors, names: Sequence[str]) -> list[str]:
    if not errors.enough:
        return [method, *[""] * 8, "refused"]
    poles = [i for i, name in enumerate(names) if name.startswith("pole")]
    responses = [i for i in range(len(names)) if i not in poles]
    row = [method]
    for inside, scale in ((poles, 1.0), (responses, 100.0)):
        at = _worst(errors, inside)
        words = names[at].removeprefix("pole ").removeprefix("response at ")
        numbers = scale * errors.bias[at], errors.t[at], scale * errors.rms[at]
        row += [words, *(f"{v:.{d}f}" for v, d in zip(numbers, (4, 1, 4) if scale == 1.0 else (1, 1, 1)))]
    return [*row, "yes" if errors.biased else "none seen"]


STUDY = Study(
    __doc__ or "",
    attempt,
    LOOPS,
    sheets,
    seeds=50,
    one_of="loop",
    options={
        "samples": Option([2000, 8000], "lengths of the records", least=1, several=True),
        "vehicle": Option(VEHICLE, "a torpedo with gains for pitch"),
        "methods": Option(list(estimators()), "which are tried", tuple(estimators()), several=True),
    },
    remarks=refusals,
    pictures=pictures,
    doing="records",
)

if __name__ == "__main__":
    sys.exit(STUDY.main())
