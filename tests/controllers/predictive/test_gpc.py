import pickle
from dataclasses import replace
from math import inf, pi, radians

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from auv_gym.models.linear import Polynomial, StateSpace, linearise
from auv_gym.plant import load_vehicle
from controllers.controller import Controller
from controllers.predictive.gpc import Gpc

PITCH = radians(5.0)
LIMIT = 0.349
PLANES = ("stern_plane_rad", "bow_plane_rad")


@pytest.fixture(scope="module")
def diving() -> StateSpace:
    """The vertical plane of the NPS AUV, by two planes."""
    return linearise(load_vehicle("npsauv"), outputs=("depth_m", "pitch_rad"), dt=1.0)


def diver(model, **settings) -> Gpc:
    usual = {
        "weights": {"depth_m": 0.4, "pitch_rad": 2.0},
        "nominal": {"pitch_rad": 0.0},
        "input_limits": dict.fromkeys(PLANES, (-LIMIT, LIMIT)),
        "rate_limits": dict.fromkeys(PLANES, 0.1),
        "output_limits": {"pitch_rad": (-PITCH, PITCH)},
    }
    return Gpc(model, **{**usual, **settings})


def turning(**settings) -> Gpc:
    return Gpc(yaw(), **{"weights": {"heading_rad": 3.0}, "input_limits": {"rudder_rad": (-0.4, 0.4)}, **settings})


def yaw(c=()) -> Polynomial:
    """Heading by a rudder: an integrator, a lag, and a coefficient more of noise."""
    return Polynomial.from_coefficients(
        {"heading_rad": [-1.7, 0.7]}, {"heading_rad": {"rudder_rad": [0.05, 0.04]}}, 1.0, c={"heading_rad": list(c)}
    )


def follow(gpc, plant, targets, *, push=0.0, shift=0.0, start=None, x=None):
    """Outputs, inputs and flags of a closed loop with a linear plant.

    push: added to the inputs, shift: to the outputs, both unseen.
    """
    x = plant.initial(np.zeros(len(plant.outputs)) if start is None else start) if x is None else x
    state, outputs, inputs, flags = gpc.start(), [], [], []
    for k in range(len(targets)):
        y = plant.output(x) + shift
        read = {**dict(zip(plant.outputs, y)), "dt_s": plant.dt}
        command, state = gpc.act(state, read, {gpc.targets[0]: targets[k]})
        u = np.array([command[name] for name in plant.inputs])
        outputs.append(y)
        inputs.append(u)
        flags.append(command["infeasible_flag"])
        x = plant.step(x, u + push)
    return np.array(outputs), np.array(inputs), np.array(flags)


def test_it_is_a_controller(diving):
    gpc = diver(diving)
    assert isinstance(gpc, Controller)
    assert gpc.targets == ("depth_m",)
    assert gpc.commands == PLANES


def test_without_limits_it_is_the_closed_form(diving):
    """(G' Q G + R)^-1 G' Q (w - free response), both from runs of the model."""
    weights, moves, horizon = {"depth_m": 0.4, "pitch_rad": 2.0}, 4, 12
    gpc = Gpc(
        diving, weights, horizon=horizon, moves=moves, first=2, move_weights={PLANES[0]: 3.0, PLANES[1]: 5.0},
        nominal={"pitch_rad": 0.01},
    )  # fmt: skip
    start = diving.initial(np.array([2.0, 0.05]))

    def outputs(x, u):
        found = []
        for row in u:
            x = diving.step(x, row)
            found.append(diving.output(x))
        return np.array(found)[1:]  # from 2 samples ahead on

    held = np.tile(diving.input_offset, (horizon, 1))
    free = outputs(start, held)
    columns = []
    for move in range(moves):
        for i in range(2):
            moved = held.copy()
            moved[move:, i] += 1.0
            columns.append((outputs(start, moved) - free).ravel())
    g = np.array(columns).T
    q, r = np.diag(np.tile([0.4**2, 2.0**2], horizon - 1)), np.diag(np.tile([3.0**2, 5.0**2], moves))
    wanted = np.tile([7.0, 0.01], horizon - 1)
    expected = np.linalg.solve(g.T @ q @ g + r, g.T @ q @ (wanted - free.ravel()))[:2]
    command, _ = gpc.act(gpc.start(), {"depth_m": 2.0, "pitch_rad": 0.05, "dt_s": 1.0}, {"depth_m": 7.0})
    assert [command[name] for name in PLANES] == pytest.approx(diving.input_offset + expected, abs=1e-9)


def first_moves(gpc: Gpc) -> np.ndarray:
    """The first change of the inputs per entry of [estimate | goals | references], of a controller without limits."""
    moves = [gpc.program.solve(entry) for entry in np.eye(gpc.program.slope.shape[1])]
    return np.array([move[0] for move in moves if move is not None]).T


def test_over_a_long_horizon_it_is_the_linear_quadratic_regulator(diving):
    weights, move_weights = np.array([0.4, 2.0]), np.array([5.0, 5.0])
    n = len(diving.states)
    a = np.block([[diving.a, diving.b], [np.zeros((2, n)), np.eye(2)]])
    b = np.vstack([diving.b, np.eye(2)])
    c = np.hstack([diving.c, np.zeros((2, 2))])
    cost = solve_discrete_are(a, b, c.T @ np.diag(weights**2) @ c, np.diag(move_weights**2))
    expected = -np.linalg.solve(b.T @ cost @ b + np.diag(move_weights**2), b.T @ cost @ a)
    at = [*range(n), n + 2, n + 3]  # between the states and the last inputs stand two disturbances
    errors = []
    for horizon in (60, 120, 400):
        gpc = Gpc(
            diving, dict(zip(diving.outputs, weights)), horizon=horizon, moves=min(horizon, 120),
            move_weights=dict(zip(PLANES, move_weights)), nominal={"pitch_rad": 0.0},
        )  # fmt: skip
        errors.append(np.abs(first_moves(gpc)[:, at] - expected).max() / np.abs(expected).max())
    assert errors[2] < errors[1] < 0.1 * errors[0]
    assert errors[2] < 1e-4  # what the slowest pole leaves after 400 samples


@pytest.mark.parametrize("seed", range(12))
def test_limits_are_never_broken_without_model_error(diving, seed):
    rng = np.random.default_rng(seed)
    gpc = diver(diving, moves=int(rng.integers(2, 12)), weights={"depth_m": rng.uniform(0.05, 4.0)}, nominal={})
    targets = np.repeat(rng.uniform(-30.0, 30.0, 5), 25)
    start = np.array([rng.uniform(-20.0, 20.0), rng.uniform(-0.9, 0.9) * PITCH])
    # the vehicle is where the filter takes it to be: at rest, as far as it can with its nose up or down
    outputs, inputs, flags = follow(gpc, diving, targets, start=start)
    assert not flags.any()
    assert np.abs(inputs).max() <= LIMIT
    moves = np.diff(np.vstack([np.zeros(2), inputs]), axis=0)
    assert np.abs(moves).max() <= 0.1 * diving.dt + 1e-7
    assert np.abs(outputs[:, 1]).max() <= PITCH * (1.0 + 1e-6)


@pytest.mark.parametrize("vehicle, planes", [("npsauv", 2), ("heu_torpedo", 1)])
@pytest.mark.parametrize("kind", ["planes", "pitch sensor"])
def test_a_constant_disturbance_leaves_no_offset(vehicle, planes, kind):
    model = linearise(load_vehicle(vehicle), outputs=("depth_m", "pitch_rad"), dt=1.0)
    limits = dict.fromkeys(model.inputs, (-LIMIT, LIMIT))
    weights = {"depth_m": 0.4, "pitch_rad": 5.0} if planes == 2 else {"depth_m": 0.4}
    gpc = Gpc(
        model, weights, input_limits=limits, nominal={"pitch_rad": 0.0} if planes == 2 else {},
        output_limits={"pitch_rad": (-0.3, 0.3)},
    )  # fmt: skip
    push = np.array([0.03, -0.02])[:planes] if kind == "planes" else 0.0
    shift = np.array([0.0, 0.02]) if kind == "pitch sensor" else 0.0
    outputs, inputs, _ = follow(gpc, model, np.full(600, 3.0), push=push, shift=shift)
    assert np.abs(outputs[-1, 0] - 3.0) < 1e-6
    assert np.abs(inputs[-1]).max() < LIMIT


def test_disturbances_are_taken_where_they_can_be_told_apart(diving):
    assert diver(diving).disturbances == PLANES
    one = linearise(load_vehicle("heu_torpedo"), outputs=("depth_m", "pitch_rad"))
    gpc = Gpc(one, {"depth_m": 1.0}, input_limits={PLANES[0]: (-0.4, 0.4)})
    assert gpc.disturbances == ("stern_plane_rad", "pitch_rad offset")
    two_integrators = StateSpace(
        np.eye(2), np.ones((2, 1)), np.eye(2), ("rudder_rad",), ("heading_rad", "depth_m"), 1.0
    )  # fmt: skip
    limits = {"rudder_rad": (-1.0, 1.0)}
    with pytest.raises(ValueError, match="cannot be told apart"):
        first_moves(Gpc(two_integrators, {"depth_m": 1.0}, input_limits=limits))
    unseen = replace(two_integrators, c=np.array([[1.0, 0.0], [1.0, 0.0]]))
    with pytest.raises(ValueError, match="do not show an integrating state"):
        first_moves(Gpc(unseen, {"depth_m": 1.0}, input_limits=limits))


@pytest.mark.parametrize("c", [(), (-0.5,), (-0.8, 0.15)])
def test_a_polynomial_model_plans_as_its_state_space_does(c):
    """Without noise or model error the filters have nothing to say."""
    targets = np.repeat([1.0, -0.5, 0.3], 30)
    carima = Gpc(yaw(c), {"heading_rad": 3.0}, input_limits={"rudder_rad": (-0.4, 0.4)})
    space = replace(carima, model=yaw(c).to_state_space())
    one, two = follow(carima, yaw(c), targets), follow(space, yaw(c), targets)
    assert one[1] == pytest.approx(two[1], abs=1e-7)
    assert np.abs(one[1]).max() == pytest.approx(0.4)
    assert one[0][29] == pytest.approx(1.0, abs=1e-3)


def test_the_carima_filter_is_the_difference_equation():
    """y(t) of (1 - q) A y = B du + C e, one sample ahead, by hand from past outputs, moves and errors."""
    model, rng = yaw((-0.5,)), np.random.default_rng(0)
    increments = Gpc(model, {"heading_rad": 3.0}, move_weights={"rudder_rad": 1.0})._parts.increments
    a = np.convolve([1.0, -1.7, 0.7], [1.0, -1.0])
    y, u, e = np.zeros(40), 0.1 * rng.standard_normal(40), 0.01 * rng.standard_normal(40)
    du = np.diff(np.concatenate([[0.0], u]))
    z, last = increments.initial(np.zeros(1), np.zeros(1)), 0.0
    for t in range(40):
        ahead = -sum(a[j] * y[t - j] for j in range(1, min(t, 3) + 1)) - 0.5 * last
        ahead += sum((0.05, 0.04)[j - 1] * du[t - j] for j in range(1, min(t, 2) + 1))
        assert (increments.c @ z)[0] == pytest.approx(ahead, abs=1e-10)
        y[t], last = ahead + e[t], e[t]
        z = z + increments.gain @ np.array([y[t] - (increments.c @ z)[0]])
        z = increments.a @ z + increments.b @ du[t : t + 1]


@pytest.mark.parametrize("observer", [(), (-0.8,), (-1.4, 0.5)])
def test_a_polynomial_model_has_no_offset_under_a_disturbance(observer):
    outputs, _, _ = follow(turning(observer=observer), yaw(), np.full(250, 0.5), push=np.array([0.1]))
    assert outputs[-1, 0] == pytest.approx(0.5, abs=1e-6)


@pytest.mark.parametrize("kind", ["state space", "polynomial"])
def test_a_model_that_is_a_little_wrong_still_gets_there(kind):
    wrong = replace(yaw(), a=np.array([1.0, -1.62, 0.62])[:, None, None], b=1.4 * yaw().b)
    gpc = Gpc(
        wrong if kind == "polynomial" else wrong.to_state_space(), {"heading_rad": 3.0},
        input_limits={"rudder_rad": (-0.4, 0.4)},
    )  # fmt: skip
    outputs, _, _ = follow(gpc, yaw(), np.full(200, 1.0), push=np.array([0.05]))
    assert outputs[-1, 0] == pytest.approx(1.0, abs=1e-5)
    assert outputs.max() < 1.4


def test_units_do_not_decide_where_the_disturbance_is():
    """A shaft with a lag, in turns a minute: its disturbance is still told from the speed's."""
    model = linearise(load_vehicle("npsauv"), ("propeller_rpm",))
    gpc = Gpc(model, {"u_mps": 5.0}, input_limits={"propeller_rpm": (0.0, 1500.0)})
    assert gpc.disturbances == ("propeller_rpm",)


def test_without_a_plan_within_the_limits_the_last_one_goes_on():
    gpc = turning(rate_limits={"rudder_rad": 0.05})
    state = gpc.start()
    command, state = gpc.act(state, {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 1.0})
    assert command == {"rudder_rad": pytest.approx(0.05), "infeasible_flag": 0.0}
    planned = state.plan[0]
    # the rudder was found hard over, from where it cannot come back within its rate
    read = {"heading_rad": 0.0, "rudder_rad": 0.9, "dt_s": 1.0}
    command, state = gpc.act(state, read, {"heading_rad": 1.0})
    assert command == {"rudder_rad": pytest.approx(planned[0]), "infeasible_flag": 1.0}
    assert state.infeasible == 1
    for _ in range(15):  # to the end of the plan, and beyond
        command, state = gpc.act(state, read, {"heading_rad": 1.0})
        assert abs(command["rudder_rad"]) <= 0.4
    assert state.infeasible == 16
    command, state = gpc.act(state, {"heading_rad": 0.0, "dt_s": 1.0}, {"heading_rad": 1.0})
    assert command["infeasible_flag"] == 0.0


def test_an_output_limit_that_cannot_be_kept_is_broken_as_little_as_possible(diving):
    outputs, inputs, flags = follow(diver(diving), diving, np.full(60, 5.0), start=np.array([0.0, 3.0 * PITCH]))
    assert not flags.any()
    assert np.abs(inputs).max() <= LIMIT
    assert outputs[0, 1] > PITCH
    assert np.abs(outputs[12:, 1]).max() <= PITCH * (1.0 + 1e-6)


def test_there_is_a_plan_from_anywhere(diving):
    """From states far outside of the limits, hundreds of them: always a plan, and within the planes' limits."""
    program, rng = diver(diving, rate_limits={}).program, np.random.default_rng(0)
    for size in np.repeat([0.1, 1.0, 10.0], 100):
        s = size * rng.standard_normal(program.slope.shape[1])
        s[len(diving.states) + 2 : len(diving.states) + 4] = 0.0  # the planes as they were
        planes = np.cumsum(program.solve(s), axis=0)
        assert np.abs(planes).max() <= LIMIT * (1.0 + 1e-6)


def test_a_reading_that_is_missing_counts_as_predicted():
    gpc, plant = turning(), yaw()
    x, state = plant.initial(np.zeros(1)), gpc.start()
    for k in range(30):
        read = {"heading_rad": float(plant.output(x)[0]), "dt_s": 1.0}
        command, after = gpc.act(state, read, {"heading_rad": 1.0})
        if k:
            for missing in ({**read, "heading_rad": np.nan}, {"dt_s": 1.0}):
                blind, _ = gpc.act(state, missing, {"heading_rad": 1.0})
                assert blind["rudder_rad"] == pytest.approx(command["rudder_rad"], abs=1e-9)
        state = after
        x = plant.step(x, np.array([command["rudder_rad"]]))


def test_between_its_samples_the_command_is_held():
    gpc = turning()
    read = {"heading_rad": 0.0, "dt_s": 0.25}
    first, state = gpc.act(gpc.start(), read, {"heading_rad": 1.0})
    for _ in range(3):
        held, state = gpc.act(state, {**read, "heading_rad": 0.7}, {"heading_rad": -1.0})
        assert held == first
    acted, state = gpc.act(state, read, {"heading_rad": -1.0})
    assert acted != first
    with pytest.raises(ValueError, match=r"steps 1 s at a time, 1 to a plan, got a call 1\.5 s"):
        gpc.act(state, {**read, "dt_s": 1.5}, {"heading_rad": 1.0})


def slowly(model: StateSpace, samples: int) -> StateSpace:
    """The same model over so many samples, its inputs held."""
    powers = [np.linalg.matrix_power(model.a, k) for k in range(samples + 1)]
    return replace(model, a=powers[-1], b=sum(powers[:-1]) @ model.b, dt=samples * model.dt)


def test_plans_of_several_samples_are_those_of_a_slow_model(diving):
    """At rest the filter has nothing to say: only the plan counts, and its limits."""
    quick, slow = diver(diving, every=4), diver(slowly(diving, 4))
    read = {"depth_m": 3.0, "pitch_rad": 0.0}
    for target in (2.9, 30.0):
        one, _ = quick.act(quick.start(), {**read, "dt_s": 1.0}, {"depth_m": target})
        two, _ = slow.act(slow.start(), {**read, "dt_s": 4.0}, {"depth_m": target})
        assert one == pytest.approx(two, abs=1e-9)


def test_between_plans_the_filter_goes_on(diving):
    gpc, quick = diver(diving, every=4), diver(diving)
    x, state = diving.initial(np.zeros(2)), gpc.start()
    commands, estimates = [], []
    for _ in range(9):
        y = diving.output(x)
        command, state = gpc.act(state, {**dict(zip(diving.outputs, y)), "dt_s": 1.0}, {"depth_m": 5.0})
        commands.append(tuple(command[name] for name in PLANES))
        estimates.append(state.estimate[: len(x)])
        assert np.abs(estimates[-1] - x).max() < 1e-9
        x = diving.step(x, np.array(commands[-1]))
    assert len(set(commands)) == 3
    assert commands[0] == commands[3] != commands[4] == commands[7] != commands[8]
    read = {"depth_m": 4.0, "pitch_rad": 0.0, "dt_s": 1.0}
    held, after = gpc.act(state._replace(since=0), read, {"depth_m": 5.0})
    other, same = quick.act(state._replace(since=0), read, {"depth_m": 5.0})
    assert tuple(held[name] for name in PLANES) == commands[-1] != tuple(other[name] for name in PLANES)
    assert after.estimate == pytest.approx(same.estimate, abs=1e-12)


def test_a_call_that_comes_late_counts_as_readings_missed(diving):
    gpc, read = diver(diving, every=4), {"depth_m": 1.0, "pitch_rad": 0.01}
    _, state = gpc.act(gpc.start(), {**read, "dt_s": 1.0}, {"depth_m": 5.0})
    _, late = gpc.act(state, {**read, "dt_s": 3.0}, {"depth_m": 5.0})
    for _ in range(2):
        _, state = gpc.act(state, {"dt_s": 1.0}, {"depth_m": 5.0})
    _, state = gpc.act(state, {**read, "dt_s": 1.0}, {"depth_m": 5.0})
    assert late.since == state.since == 3
    assert late.estimate == pytest.approx(state.estimate, abs=1e-12)
    with pytest.raises(ValueError, match="4 to a plan, got a call 5 s"):
        gpc.act(state, {**read, "dt_s": 5.0}, {"depth_m": 5.0})


def test_it_turns_the_short_way_and_past_south():
    gpc, plant = turning(), yaw()
    outputs, inputs, _ = follow(gpc, plant, np.full(80, -pi + 0.2), start=np.array([pi - 0.2]))
    assert inputs[0, 0] > 0.0
    assert outputs[-1, 0] == pytest.approx(pi + 0.2, abs=1e-4)
    state, x, commands = gpc.start(), plant.initial(np.array([pi - 0.2])), []
    for _ in range(80):  # as a compass has it
        read = {"heading_rad": (float(plant.output(x)[0]) + pi) % (2.0 * pi) - pi, "dt_s": 1.0}
        command, state = gpc.act(state, read, {"heading_rad": -pi + 0.2})
        commands.append(command["rudder_rad"])
        x = plant.step(x, np.array([commands[-1]]))
    assert np.array(commands) == pytest.approx(inputs[:, 0], abs=1e-9)


def test_the_reference_goes_to_the_target_in_its_time():
    slow, quick = turning(reference_time=10.0), turning()
    (slowly, _, _), (quickly, _, _) = (follow(gpc, yaw(), np.full(120, 1.0)) for gpc in (slow, quick))
    assert slowly[10, 0] < 0.75 < quickly[10, 0]
    assert slowly[-1, 0] == pytest.approx(1.0, abs=1e-4)


def test_acting_is_pure_and_it_can_be_sent_to_another_process(diving):
    gpc = diver(diving)
    read, target = {"depth_m": 1.0, "pitch_rad": 0.01, "dt_s": 1.0}, {"depth_m": 9.0}
    _, state = gpc.act(gpc.start(), read, target)
    before = state.estimate.copy()
    one, _ = gpc.act(state, read, target)
    gpc.act(gpc.start(), {**read, "depth_m": -30.0}, target)
    two, _ = gpc.act(state, read, target)
    assert one == two
    assert np.array_equal(state.estimate, before)
    sent, carried = pickle.loads(pickle.dumps((gpc, state)))
    assert sent.act(carried, read, target)[0] == one


def test_a_target_that_is_missing_is_asked_for():
    with pytest.raises(ValueError, match="needs a target for heading_rad, got targets for depth_m"):
        turning().act(turning().start(), {"heading_rad": 0.0, "dt_s": 1.0}, {"depth_m": 1.0})


@pytest.mark.parametrize(
    "change, message",
    [
        ({"weights": {"depth_m": 1.0}}, "weights name 'depth_m'"),
        ({"weights": {}}, "weight above 0"),
        ({"weights": {"heading_rad": -1.0}}, "weight above 0"),
        ({"horizon": 5}, "moves <= horizon"),
        ({"first": 0}, "1 <= first"),
        ({"every": 0}, "every 1 or more samples"),
        ({"input_limits": {"rudder_rad": (0.4, -0.4)}}, "low < high"),
        ({"input_limits": {}}, "neither for 'rudder_rad'"),
        ({"input_limits": {"rudder_rad": (0.1, 0.4)}}, "neutral inputs within"),
        ({"rate_limits": {"rudder_rad": 0.0}}, "rate_limits above 0"),
        ({"output_limits": {"heading_rad": (1.0, 1.0)}}, "low < high"),
        ({"soft": 0.0}, "soft, effort, drift_factor above 0"),
        ({"effort": 0.0}, "soft, effort, drift_factor above 0"),
        ({"reference_time": inf}, "reference_time"),
        ({"drift": {"rudder": 1.0}}, "drift name 'rudder'"),
        ({"model": load_vehicle}, "needs a linear model"),
    ],
)
def test_what_cannot_be_planned_is_refused(change, message):
    with pytest.raises(ValueError, match=message):
        replace(turning(), **change)


def test_a_filter_that_is_not_stable_is_refused():
    gpc = Gpc(yaw((-1.0,)), {"heading_rad": 1.0}, move_weights={"rudder_rad": 1.0})
    with pytest.raises(ValueError, match="zeros of C inside the unit circle"):
        first_moves(gpc)
    assert np.isfinite(first_moves(replace(gpc, observer=(-0.8,)))).all()
