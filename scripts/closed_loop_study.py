"""Which methods are biased by feedback: pitch held by a PID, PRBS at the plane, a coloured disturbance, many seeds.

    python -m scripts.closed_loop_study --seeds 50 --out closed_loop

The truth is the pitch of a torpedo's linear form, so that its poles and its response are known. Each seed is one record
in closed loop and one in open loop, of which the first part and the whole are fitted by every method with the right
orders. A bias is a mean error over the seeds that is larger than 1 % of a response, or 0.01 of a pole, by more than its
standard error explains; with more samples it stays, where scatter shrinks. A vehicle that is unstable by itself has no
open loop.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import stats
from scipy.optimize import linear_sum_assignment

from auv_gym.cli.options.console import table
from auv_gym.model import Diverged
from auv_gym.models.linear import Polynomial, StateSpace, linearise
from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from auv_gym.writing import replacing
from controllers.gains import gains_for
from controllers.pid import Pid
from identification.estimator import Estimator
from identification.experiments.excitation import prbs
from identification.linear.polynomials.armax import Armax
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.output_error import OutputError
from identification.linear.subspaces.n4sid import N4sid
from identification.linear.subspaces.pbsid import Pbsid
from scripts.over_seeds import all_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

VEHICLE, DT = "heu_torpedo", 0.5  # s
PLANE, PITCH = "stern_plane_rad", "pitch_rad"
STATES = ("w_mps", "q_radps", PITCH)
ORDER = len(STATES)
COLOUR = (1.0, 0.5)  # C of C(q) / A(q), through which white noise disturbs the pitch; A has the vehicle's poles
NOISE, EXCITATION = 0.002, 0.05  # rad: of that white noise, standard deviation; of the PRBS, amplitude
HOLD = 2  # samples of the PRBS
RUN_IN = 200  # samples before a record begins
OMEGA = (0.1, 0.3, 1.0, 3.0)  # rad/s, at which responses are judged
LOOPS = ("closed", "open")
CHANCE = 0.01  # that a method without bias is called biased, over all quantities together
MATTERS = 0.01  # of a pole, and of a response relative to it: a mean error that is surely larger is a bias
_GAINS_AT = 0.1  # s, for which the vehicle's gains were tuned
_LOST = 10.0  # rad, of a pitch that nothing holds
_SPREAD = (5.0, 95.0)  # percentiles of the figure
_COLUMNS = 4  # of it


@dataclass(frozen=True, eq=False)
class Errors:
    """What a method got wrong in each seed: poles, and responses relative to the true one.

    values: (seeds, quantities), by `quantities`.  responses: those of the figure, (seeds, n).  refused: why a record
    was not fitted, of those that were not.
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
        """Whether there are seeds enough to speak of scatter."""
        return len(self.values) > 1

    @property
    def biased(self) -> bool:
        """Whether a mean error is larger than MATTERS, and chance alone would hardly bring that about."""
        return bool((self.least > MATTERS).any())

    @cached_property
    def least(self) -> np.ndarray:
        """The size that the bias of each quantity surely has, all of them together; not above zero: perhaps none."""
        seeds, count = self.values.shape
        return np.abs(self.bias) - stats.t.ppf(1.0 - 0.5 * CHANCE / count, seeds - 1) * self.error


Study = dict[tuple[str, int], dict[str, Errors]]  # by loop and samples, then by method


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study, print its tables and verdicts, draw its figures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=50, help="records in each loop (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="the first of them (default %(default)s)")
    parser.add_argument("--samples", type=int, nargs="+", default=[2000, 8000], help="lengths (default 2000 8000)")
    parser.add_argument("--vehicle", default=VEHICLE, help="a torpedo with gains for pitch (default %(default)s)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    parser.add_argument("--json", action="store_true", help="print the numbers as JSON")
    parser.add_argument("--out", type=Path, help="folder for the figures (PNG); default: no figures")
    given = parser.parse_args(argv)
    try:
        seeds = range(given.seed, given.seed + given.seeds)
        found = study(seeds, given.samples, vehicle=given.vehicle, jobs=given.jobs)
        written = [] if given.out is None else draw(found, given.vehicle, given.out)
    except (ValueError, OSError, ImportError) as error:
        print(f"Error: {error}", file=sys.stderr)
        return 1
    if given.json:
        print(json.dumps(as_json(found, given.vehicle), indent=1))
        return 0
    console = Console(highlight=False, width=max(Console().width, 130))
    for (loop, samples), by_method in found.items():
        console.print(_table(loop, samples, by_method, quantities(truth(given.vehicle))))
    for line in verdicts(found, given.vehicle):
        console.print(line, markup=False, soft_wrap=True)
    for path in written:
        console.print(f"Written to {path}", markup=False, soft_wrap=True)
    return 0


@lru_cache(maxsize=4)
def truth(vehicle: str = VEHICLE) -> Polynomial:
    """The pitch of a vehicle whose plane follows its command at once, and what disturbs it, as ARMAX."""
    quick = {"parts.stern_plane.lag": 0.0, "parts.stern_plane.slowness": 0.0}
    form = linearise(replace_at(load_vehicle(vehicle), quick), [PLANE], [PITCH], states=STATES, dt=DT)
    a = np.real(np.poly(form.poles()))
    impulse = [(form.c @ np.linalg.matrix_power(form.a, k) @ form.b).item() for k in range(ORDER)]
    b = np.convolve(a, impulse)[:ORDER]
    return Polynomial.from_coefficients(
        {PITCH: a[1:].tolist()}, {PITCH: {PLANE: b.tolist()}}, DT, c={PITCH: COLOUR[1:]}
    )


def pitch_pid(vehicle: str = VEHICLE) -> Pid:
    """The vehicle's own pitch controller, told the pitch alone, without limits: the loop is linear."""
    gains = gains_for(vehicle, _GAINS_AT).loops["pid"]["pitch"]
    return Pid(gains["proportional"], gains["integral"], gains["derivative"], measured=PITCH, command=PLANE)


def methods() -> dict[str, Estimator]:
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


def study(
    seeds: Sequence[int],
    samples: Sequence[int],
    *,
    vehicle: str = VEHICLE,
    loops: Sequence[str] = (),
    chosen: Sequence[str] = (),
    jobs: int = 1,
) -> Study:
    """The errors of the chosen methods, default all; loops: default both, or closed alone for an unstable vehicle."""
    if len(seeds) < 2 or min(samples, default=0) < 1 or jobs < 1:
        raise ValueError(
            f"Needed --seeds of at least 2, --samples and --jobs of at least 1, got {len(seeds)}, {list(samples)} and "
            f"{jobs}."
        )
    stable = truth(vehicle).state_space.is_stable()
    loops = loops or (LOOPS if stable else LOOPS[:1])
    if not stable and "open" in loops:
        raise ValueError(f"The pitch of {vehicle!r} is unstable by itself: study it in closed loop alone.")
    tasks = [(loop, seed) for loop in loops for seed in seeds]
    asked = [(seed, sorted(samples), loop, vehicle, chosen) for loop, seed in tasks]
    found = all_of(attempt, asked, jobs, "fitting", "records")
    return {
        (loop, length): _gathered([of[length] for (mine, _), of in zip(tasks, found) if mine == loop])
        for loop in loops
        for length in sorted(samples)
    }


# values by `quantities` and responses by `response_grid` of Errors, or why a record was not fitted
Attempt = dict[int, dict[str, tuple[np.ndarray, np.ndarray] | str]]


def attempt(
    seed: int, samples: Sequence[int], loop: str = "closed", vehicle: str = VEHICLE, chosen: Sequence[str] = ()
) -> Attempt:
    """The errors of each method in the first so many samples of one record, by samples, then by method."""
    record, true = simulated(seed, max(samples), loop, vehicle), truth(vehicle)
    tried = {name: method for name, method in methods().items() if not chosen or name in chosen}
    found: Attempt = {}
    for length in samples:
        part, found[length] = record.select(np.arange(len(record)) < length), {}
        for name, method in tried.items():
            try:
                model: Any = method.fit(part).model
                found[length][name] = (_wrong(model, true), _off(model, true, response_grid()))
            except (ValueError, Diverged) as error:
                found[length][name] = str(error)
    return found


def quantities(true: Polynomial) -> tuple[str, ...]:
    """Names of what is judged."""
    poles = _poles(true)
    named = []
    for number, pole in enumerate(poles[np.imag(poles) >= 0.0], start=1):
        named += [f"pole {number} (real)", f"pole {number} (imaginary)"] if pole.imag > 0.0 else [f"pole {number}"]
    return (*named, *(f"response at {at:g} rad/s ({part})" for part in ("real", "imaginary") for at in OMEGA))


def response_grid() -> np.ndarray:
    """Frequencies of the figure, rad/s."""
    return np.geomspace(OMEGA[0], 0.9 * np.pi / DT, 40)


def verdicts(found: Study, vehicle: str = VEHICLE) -> list[str]:
    """A line for each loop and method, of the longest records."""
    names, lines = quantities(truth(vehicle)), []
    for loop in dict.fromkeys(loop for loop, _ in found):
        samples = max(length for of, length in found if of == loop)
        for method, errors in found[loop, samples].items():
            lines.append(f"{loop} loop, {samples} samples, {method}: {_verdict(errors, names)}")
    return lines


def as_json(found: Study, vehicle: str = VEHICLE) -> dict[str, Any]:
    """The truth, and by loop, samples and method what was found."""
    true = truth(vehicle)
    names = quantities(true)
    told: dict[str, Any] = {loop: {} for loop, _ in found}
    for (loop, samples), by_method in found.items():
        told[loop][str(samples)] = {
            method: {
                "seeds": len(errors.values),
                "refused": len(errors.refused),
                "biased": errors.biased if errors.enough else None,
                "quantities": _numbers(errors, names) if errors.enough else {},
            }
            for method, errors in by_method.items()
        }
    poles = [[float(pole.real), float(pole.imag)] for pole in _poles(true)]
    return {"vehicle": vehicle, "dt_s": DT, "poles": poles, "loops": told}


def draw(found: Study, vehicle: str, folder: Path) -> list[Path]:
    """A figure for each loop, of the longest records; the files written."""
    from matplotlib import rc_context

    from identification.pages.drawing import STYLE

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for loop in dict.fromkeys(loop for loop, _ in found):
        samples = max(length for of, length in found if of == loop)
        path = folder / f"{loop}_loop_{vehicle}.png"
        with rc_context(STYLE), replacing(path) as new:
            figure = response_figure(found[loop, samples], truth(vehicle), f"{loop} loop, {samples} samples")
            figure.savefig(new, format="png", dpi=130, facecolor="white")
        written.append(path)
    return written


def response_figure(by_method: Mapping[str, Errors], true: Polynomial, words: str) -> Figure:
    """Gain and phase that each method finds, mean and the band that nine seeds of ten lie in, over the true ones."""
    from identification.pages.drawing import AFTER, BEFORE, INK, grid, new_figure

    omega = response_grid()
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


def _gathered(attempts: Sequence[Mapping[str, tuple[np.ndarray, np.ndarray] | str]]) -> dict[str, Errors]:
    """The errors of all seeds, by method."""
    gathered = {}
    for name in attempts[0]:
        done = [of[name] for of in attempts]
        good = [found for found in done if not isinstance(found, str)]
        values, responses = (np.array([found[part] for found in good]) for part in (0, 1))
        gathered[name] = Errors(values, responses, tuple(found for found in done if isinstance(found, str)))
    return gathered


def _wrong(model: Polynomial | StateSpace, true: Polynomial) -> np.ndarray:
    """Errors of a model by `quantities`; poles are paired with the true ones so that distances add up to the least."""
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


def _numbers(errors: Errors, names: Sequence[str]) -> dict[str, dict[str, float]]:
    heads, columns = ("bias", "standard_error", "t", "rms"), (errors.bias, errors.error, errors.t, errors.rms)
    return {name: dict(zip(heads, map(float, row))) for name, row in zip(names, zip(*columns))}


def _worst(errors: Errors, inside: Sequence[int]) -> int:
    """Of these quantities, the number of the one whose bias is the surest."""
    return inside[int(np.argmax(np.abs(errors.t[list(inside)])))]


def _verdict(errors: Errors, names: Sequence[str]) -> str:
    if not errors.enough:
        return f"refused ({errors.refused[0]})"
    at = _worst(errors, range(len(names)))
    rest = f"; {len(errors.refused)} records refused" if errors.refused else ""
    surest = f"t = {errors.t[at]:.1f}, {errors.bias[at]:.4f} in {names[at]}"
    if errors.biased:
        return f"biased ({surest}){rest}"
    return f"none seen beyond {MATTERS:g} (surest: {surest}){rest}"


def _table(loop: str, samples: int, by_method: Mapping[str, Errors], names: Sequence[str]) -> Table:
    shown = table(
        f"{loop.capitalize()} loop, {samples} samples, {_seeds(by_method)} seeds: mean errors and how sure they are",
        "method!",
        "pole worst off!",
        "bias>",
        "t>",
        "rms>",
        "response worst off!",
        "bias, %>",
        "t>",
        "rms, %>",
        "bias",
    )
    poles = [i for i, name in enumerate(names) if name.startswith("pole")]
    responses = [i for i in range(len(names)) if i not in poles]
    for method, errors in by_method.items():
        if not errors.enough:
            shown.add_row(method, *[""] * 8, "refused")
            continue
        row: list[str] = [method]
        for inside, scale in ((poles, 1.0), (responses, 100.0)):
            at = _worst(errors, inside)
            words = names[at].removeprefix("pole ").removeprefix("response at ")
            numbers = scale * errors.bias[at], errors.t[at], scale * errors.rms[at]
            row += [words, *(f"{v:.{d}f}" for v, d in zip(numbers, (4, 1, 4) if scale == 1.0 else (1, 1, 1)))]
        shown.add_row(*row, "yes" if errors.biased else "none seen")
    return shown


if __name__ == "__main__":
    sys.exit(main())
