"""The blind benchmark: own simulators agree with the plants, cases repeat, truths are sealed, scores are fair."""

import json
from dataclasses import replace

import numpy as np
import pytest

from auv_gym.param import replace_at, value_at
from auv_gym.plant import load_vehicle
from auv_gym.records.record import Record
from controllers.pid import heading_pid
from identification.diagnosis.log.parts import parts_of, windows_of
from identification.experiments.float_dives import depth_control, oil_mission
from identification.experiments.heading_control import closed_loop
from identification.fit.validation import free_runs
from identification.fit.windows import free_run_windows
from scripts.blind import cases, outside
from scripts.blind.cases import KINDS, PERIOD_OF, Case, Undrawn, detectable_sizes, draw, sketch
from scripts.blind.diagnosing import diagnose_folder
from scripts.blind.disturbances import Around, Slack, Sticking, Tripping, slipped
from scripts.blind.kinds import kind_of, log_of, outside_log
from scripts.blind.logs import Conditions, heaved
from scripts.blind.outside import EXCESS, excess, sized
from scripts.blind.own_float import OwnSwim
from scripts.blind.own_glider import OwnGlider
from scripts.blind.own_torpedo import own_manoeuvres
from scripts.blind.pushed import pushed_log, pushed_plant
from scripts.blind.sampling import REALISTIC
from scripts.blind.scoring import error_ratio, score, score_folders
from scripts.blind.sealing import log_folder, seal, truth_folder
from scripts.blind.tables import exact_interval, summary
from scripts.blind_benchmark import chosen, main, run_case
from scripts.studies.changes import changing_log

QUIET = Conditions(1.0, 1.0, 300.0)


@pytest.mark.parametrize("vehicle", ["slocum", "ganeshblue"])
def test_the_own_glider_is_the_plant_where_nothing_is_the_matter(vehicle):
    plant = load_vehicle(vehicle)
    one = closed_loop(plant, rng=np.random.default_rng(3), duration=300.0)
    own = closed_loop(OwnGlider(plant), heading_pid(plant), rng=np.random.default_rng(3), duration=300.0)
    assert np.ptp(one["heading_rad"]) > 0.5
    # the plant's own step of up to 2 s is what differs
    np.testing.assert_allclose(own["heading_rad"], one["heading_rad"], atol=1e-4)
    np.testing.assert_allclose(own["north_m"], one["north_m"], atol=1e-3)


def own_float(plant, depth, rate=0.0, volume=0.0):
    return OwnSwim(plant, Around(), depth, rate, volume)


def test_the_own_floats_are_the_plants_where_nothing_is_the_matter():
    piston, oil = load_vehicle("qiandao_float"), load_vehicle("mermaid")
    for fly, atol in (
        # a sample of the plant is one RK4 step of up to 0.7 s, through the surface
        (lambda **k: depth_control(piston, [30.0, 10.0, 20.0], hold=100.0, rng=np.random.default_rng(1), **k), 0.02),
        (lambda **k: oil_mission(oil, [200.0, 300.0], rng=np.random.default_rng(1), **k), 0.02),
    ):
        one, own = fly(), fly(under_way=own_float)
        assert np.ptp(one["depth_m"]) > 15.0
        np.testing.assert_allclose(own["depth_m"], one["depth_m"], atol=atol)


@pytest.mark.parametrize("vehicle", ["remus100", "vt690", "npsauv"])
def test_the_own_torpedo_is_the_plant_where_nothing_is_the_matter(vehicle):
    plant = load_vehicle(vehicle)
    silent = dict.fromkeys(("inclinometer", "compass", "gyros", "dvl_water", "dvl_ground", "position", "depth"), 0.0)
    own = own_manoeuvres(plant, Around(), np.random.default_rng(2), 6.0, 0.15, silent)
    first = {name: own[name][0] for name in plant.outputs}
    start = plant.initial(np.array(list(first.values())))[: len(plant.family.states)]
    ran = plant.run(own, [slice(0, len(own))], start[None])
    assert np.ptp(own["r_radps"]) > 0.005
    for i, name in enumerate(plant.outputs):  # RK4 of 0.05 s where fins lag by 0.1 s
        np.testing.assert_allclose(ran[:, i], own[name], atol=2e-4, err_msg=name)


@pytest.mark.parametrize(
    "vehicle, path, size", [("npsauv", "effects.rudder.offset", 0.05), ("bluerov2_heavy", "effects.t3.lost", 0.5)]
)
def test_what_has_an_effect_from_a_time_on_moves_as_the_vehicle_with_it_does_from_then_on(vehicle, path, size):
    plant, quiet = load_vehicle(vehicle), Conditions(1e-9, 1.0, 20.0)
    other = replace_at(plant, path, size)
    without, having = (log_of(p, quiet, 0) for p in (plant, other))
    never, always = (changing_log(plant, other, path, quiet, 0, lambda t, s=s: s) for s in (0.0, 1.0))
    halfway = changing_log(plant, other, path, quiet, 0, lambda t: float(t >= 10.0))
    before = halfway.time < 10.0
    for name in ("r_radps", "u_mps", "heading_rad", "north_m"):
        np.testing.assert_allclose(never[name], without[name], atol=1e-6, err_msg=name)
        np.testing.assert_allclose(always[name], having[name], atol=1e-6, err_msg=name)
        np.testing.assert_array_equal(halfway[name][before], never[name][before])
    apart = np.abs(halfway["r_radps"] - never["r_radps"])
    assert apart[before].max() == 0.0
    assert apart.max() > 1e-3


@pytest.mark.parametrize(
    "vehicle, path, size", [("mermaid", "effects.volume.offset", 5e-6), ("seaglider", "effects.polar.growth", 0.3)]
)
def test_an_effect_that_begins_in_a_later_dive_leaves_those_before_it_unchanged(vehicle, path, size):
    plant, quiet = load_vehicle(vehicle), Conditions(1e-9, 1.0, 300.0)
    other = replace_at(plant, path, size)
    without, having = (log_of(p, quiet, 0) for p in (plant, other))
    never, always = (changing_log(plant, other, path, quiet, 0, lambda t, s=s: s) for s in (0.0, 1.0))
    for one, standard in ((never, without), (always, having)):
        assert one.labels == standard.labels
        np.testing.assert_allclose(one["depth_m"], standard["depth_m"], atol=1e-9)
    assert (np.diff(never.time) > 0.0).all()  # one clock for all dives
    begin = never.time[never.segments[2].start] + 1000.0
    partly = changing_log(plant, other, path, quiet, 0, lambda t: float(t >= begin))
    count = int(np.sum(never.time <= begin))
    assert count > never.segments[2].start
    np.testing.assert_array_equal(partly.time[:count], never.time[:count])
    # with a later dive of another length, other numbers are drawn for noise and heave, which are minute here
    np.testing.assert_allclose(partly["depth_m"][:count], never["depth_m"][:count], atol=1e-6)
    after = slice(count + 5, count + 10)
    assert np.abs(partly["depth_m"][after] - never["depth_m"][after]).min() > 1e-3


@pytest.mark.parametrize(
    "vehicle, duration",
    [
        ("slocum", 600.0),
        ("qiandao_float", 0.0),  # it has missions of their own length, as the next two have
        ("mermaid", 0.0),
        ("seaglider", 0.0),
        ("remus100", 100.0),
        ("bluerov2_heavy", 40.0),
    ],
)
def test_a_realistic_log_is_a_part_of_a_run_with_gaps_and_quantised_readings(vehicle, duration):
    plant, even = load_vehicle(vehicle), Conditions(1.0, 1.0, duration)
    run, log, again = (log_of(plant, c, 4) for c in (even, *[replace(even, sampling=REALISTIC)] * 2))
    np.testing.assert_array_equal(log.matrix(log.names), again.matrix(again.names))
    assert set(run.names) <= set(log.names)
    assert len(log.segments) > len(run.segments)  # there is a gap
    leading = plant.family.leading
    assert 0.9 < log.readings(leading).mean() < 1.0
    depth = log["depth_m"][log.readings("depth_m")]
    np.testing.assert_allclose(100.0 * depth, np.round(100.0 * depth), atol=1e-6)
    assert 0.7 * run.duration_s < log.duration_s < 1.1 * run.duration_s
    if "elapsed_s" in plant.inputs:  # effects that grow with time began with the run
        assert log["elapsed_s"][0] > 0.0


def test_sensors_of_a_realistic_log_have_their_own_rates_and_its_commands_are_known():
    plant = load_vehicle("remus100")
    log = log_of(plant, Conditions(1.0, 1.0, 100.0, sampling=REALISTIC), 4)
    others = ("r_radps", "u_mps", "u_dvl_mps", "north_m", "depth_m")
    intervals = {name: log.interval_of(name) for name in others}
    assert len({round(interval, 1) for interval in intervals.values()}) > 1
    for name in others:
        assert log.readings(name).mean() == pytest.approx(0.1 / intervals[name], abs=0.1)
    assert log.readings("rudder_rad").all()
    assert np.diff(log.time[log.segments[0]]).std() > 1e-4  # uneven stamps


def test_pushes_make_the_true_vehicle_err_by_the_noise_of_its_leading_sensor():
    plant = pushed_plant("ganeshblue")
    conditions = Conditions(2.0, 1.0, 600.0, push=1.0, water=7)
    log, again = (pushed_log(plant, conditions, 3) for _ in range(2))
    np.testing.assert_array_equal(log["heading_rad"], again["heading_rad"])
    runs = free_runs(plant, log, free_run_windows(plant, log, plant.window), plant.settle)
    noise = 2.0 * np.deg2rad(0.5)
    left = np.sqrt(np.mean(runs.errors(runs.channels.index("heading_rad")) ** 2) / noise**2 - 1.0)
    assert left == pytest.approx(1.0, abs=0.15)  # the noise of 500 readings gives it to about a tenth


def test_pushed_cases_are_drawn_only_if_asked_for():
    kinds = ["one_pushed", "none_pushed"]
    pushed = chosen(7, 8, kinds, None)
    assert {case.kind for case in pushed} == set(kinds)
    assert all(case.conditions.push == 1.0 for case in pushed)
    assert {case.vehicle for case in pushed} <= {"ganeshblue", "qiandao_float", "npsauv", "remus100"}
    assert {case.kind for case in chosen(7, 6, ["one", "one_pushed"], ["glider"])} == {"one", "one_pushed"}
    with pytest.raises(ValueError, match="glider, float, torpedo, got glide"):
        chosen(7, 1, kinds, ["glide"])
    case = next(case for case in pushed if case.vehicle == "qiandao_float" and case.kind == "one_pushed")
    drawn = draw(case)
    ((path, size),) = drawn.effects.items()
    assert value_at(drawn.true, path) == size
    assert drawn.fresh is not None
    assert drawn.fresh.names == drawn.record.names


def test_a_cause_gets_a_size_that_shows_and_does_not_stand_out(monkeypatch):
    monkeypatch.setattr(outside, "left_over", lambda plant, record, window: np.asarray(record))

    def uncontrolled(size):
        if size > 0.5:
            raise ValueError
        return [1.0 + 20.0 * size**2]

    for law in (lambda size: [1.0 + 300.0 * size**2], lambda size: [1.0, 1.0 + 0.2 * size], uncontrolled):
        found = sized(None, law, [1.0], 60.0)
        assert EXCESS[0] <= found.excess <= EXCESS[1]
        assert max(law(found.size)) == pytest.approx(1.0 + found.excess)
    assert sized(None, lambda size: [1.0 + 9.0 * (size > 0.3)], [1.0], 60.0) is None
    assert sized(None, lambda size: [1.0], [1.0], 60.0) is None

    def broken(size):
        raise ValueError("no such vehicle")

    with pytest.raises(ValueError, match="no such vehicle"):
        sized(None, broken, [1.0], 60.0)


def test_causes_are_absent_at_size_zero_and_do_what_they_say():
    rng = np.random.default_rng(0)
    trip = Tripping(0.5, 0.2, 0.4)
    assert [trip.tripped(False, 0.3), trip.tripped(True, 0.3), trip.tripped(True, 0.1)] == [False, True, False]
    assert trip.factor(True) == 1.5
    assert trip.factor(False) == 1.0
    fin = Sticking(0.1, np.array([[10.0, 12.0]]))
    assert [fin.position(0.0, 0.05, 1.0), fin.position(0.0, 0.2, 1.0), fin.position(0.0, 0.2, 11.0)] == [0.0, 0.2, 0.0]
    line = Slack(2.0, 10.0)
    assert line.pull(5.0) < 1e-12
    assert line.pull(15.0) == pytest.approx(10.0)
    time = np.arange(0.0, 1000.0)
    np.testing.assert_array_equal(slipped(time, rng, 0.0, 20.0), time)
    stamps = slipped(time, rng, 0.1, 20.0)
    assert 0.89 < np.diff(stamps).min() < 1.0 < np.diff(stamps).max() < 1.11


@pytest.mark.parametrize(
    "vehicle, cause",
    [
        ("slocum", "side"),
        ("qiandao_float", "side"),
        ("mermaid", "tether"),
        ("seaglider", "layer"),
        ("slocum_flight", "clock"),
    ],
)
def test_a_cause_outside_the_library_shows_in_the_log(vehicle, cause):
    plant = load_vehicle(vehicle)
    assert cause in kind_of(plant).causes
    clean, own = log_of(plant, QUIET, 5), outside_log(plant, "", 0.0, QUIET, 5)
    assert excess(plant, own, clean, plant.window) == pytest.approx(0.0, abs=0.02)
    assert excess(plant, outside_log(plant, cause, 4.0, QUIET, 5), clean, plant.window) > 1.0


def test_a_glider_that_hangs_where_it_is_neutral_is_no_case():
    half = replace_at(load_vehicle("seaexplorer"), "effects.engine.gain", 0.45)
    with pytest.raises(ValueError, match="does not come back from every dive"):
        log_of(half, Conditions(1.0, 1.2, 600.0), 0)


def test_a_case_is_the_same_whatever_else_runs():
    case = next(c for c in chosen(7, 30, ["one"], ["glider"]))
    one, again = draw(case), draw(sketch(7, case.number))
    assert one.effects == again.effects
    np.testing.assert_array_equal(one.record["heading_rad"], again.record["heading_rad"])
    ((path, value),) = one.effects.items()
    neutral = 1.0 if path.endswith(".gain") else 0.0
    assert 2.0 <= abs(value - neutral) / one.detectable[path] <= 6.0
    assert value_at(one.true, path) == value
    assert value_at(one.believed, path) == neutral
    assert {c.kind for c in chosen(7, 60, None, None)} == {kind for kind, share in KINDS.items() if share}
    assert chosen(7, 5, None, None, first=40) == chosen(7, 45, None, None)[40:]


def test_an_effect_that_does_nothing_is_not_drawn(monkeypatch):
    """Thrusters that lag by tenths of a second never meet a rate limit of a few milliseconds."""
    case = Case(0, 0, "one", "rov_attitude", "bluerov2_heavy", Conditions(1.0, 1.0, 10.0, "attitude"), 5.0, 1.0)
    monkeypatch.setattr(cases, "effects_of", lambda vehicle: ["effects.t2.slowness"])
    monkeypatch.setattr(cases, "ATTEMPTS", 2)
    monkeypatch.setattr(cases, "detectable_sizes", lambda plant, clean, paths: dict.fromkeys(paths, 1e-3))
    with pytest.raises(Undrawn):
        draw(case)
    monkeypatch.setattr(cases, "detectable_sizes", lambda plant, clean, paths: dict.fromkeys(paths, 1.0))
    assert draw(case).effects["effects.t2.slowness"] > 1.0


def test_what_a_log_hides_has_no_detectable_size():
    plant = load_vehicle("slocum")
    sizes = detectable_sizes(plant, log_of(plant, QUIET, 0).without(["north_m", "east_m"]), ["effects.current.east"])
    assert sizes["effects.current.east"] == np.inf
    gain = detectable_sizes(plant, log_of(plant, QUIET, 0), ["effects.rudder.gain"])
    assert gain["effects.rudder.gain"] == np.inf  # so does the rudder's effectiveness
    assert set(PERIOD_OF.values()) == {"effects.water.heave_period"}
    assert issubclass(Undrawn, ValueError)


def test_the_folder_that_is_diagnosed_does_not_hold_the_truth(tmp_path):
    case = chosen(3, 1, ["one_wrong"], ["glider"])[0]
    drawn = draw(case)
    log, truth = seal(drawn, tmp_path), truth_folder(tmp_path, case.number)
    assert log == log_folder(tmp_path, case.number)
    assert {p.name for p in log.iterdir()} == {"log.nc", "vehicle.toml", "frame.json"}
    believed, true = load_vehicle(log / "vehicle.toml"), load_vehicle(truth / "vehicle.toml")
    assert "effects" not in (log / "vehicle.toml").read_text()
    for path, (right, given) in drawn.wrong.items():
        assert value_at(true, path) == right
        assert value_at(believed, path) == given
        assert 0.0 < abs(given / right - 1.0) < 0.5
    assert set(drawn.wrong) == set(true.doubted)
    assert not truth.is_relative_to(log)
    assert not [k for k in Record.load(log / "log.nc").attrs if "effect" in k]


def truth(kind, effects=None, wrong=None, cause=""):
    case = {"number": 0, "kind": kind, "family": "glider", "vehicle": "slocum"}
    return {"case": case, "effects": effects or {}, "wrong": wrong or {}, "cause": cause}


def said(verdict, effects=None, tied=(), **more):
    return {
        "verdict": verdict,
        "effects": [{"path": p, "ci95": c} for p, c in (effects or {}).items()],
        "tied": tied,
    } | more


def test_names_and_ties_and_false_names_are_scored():
    one = truth("one", {"a": 2.0})
    exact = score(said("named", {"a": [1, 3]}), one)
    assert (exact["right"], exact["false"], exact["covered"]) == (True, [], {"a": True})
    tie = score(said("tied", {"b": [1, 3]}, [["b", "a"]]), one)
    assert (tie["right"], tie["false"], tie["covered"]) == (True, [], {})
    beside = score(said("named", {"a": [3, 4], "b": [0, 1]}), one)
    assert (beside["right"], beside["false"], beside["covered"]) == (True, ["b"], {"a": False})
    both = truth("two", {"a": 2.0, "c": 1.0})
    assert not score(said("named", {"a": [1, 3]}), both)["right"]
    assert score(said("tied", {"a": [1, 3], "b": [0, 1]}, [["b", "c"]]), both)["right"]
    assert not score({"verdict": "timeout"}, one)["right"]
    components = score(said("named", {"effects.current.east": [1, 2]}), truth("one", {"effects.current.north": 1.0}))
    assert (components["right"], components["false"]) == (True, [])


def test_ties_are_counted_and_their_true_member_is_judged():
    one = truth("one", {"a": 2.0}, {"k": [1.0, 1.2]})
    tied = said("tied", {"b": [1, 3]}, [["b", "a", "c"], ["k", "l"]])
    tied["effects"][0]["members"] = [{"path": "a", "ci95": [1.5, 2.5]}, {"path": "c", "ci95": [0, 1]}]
    tied["coefficients"] = [
        {"path": "k", "given": 1.2, "ci95": [0.9, 1.1]},
        {"path": "m", "given": 1.2, "ci95": [0.9, 1.1]},
        {"path": "n", "given": 1.0, "ci95": [0.9, 1.1]},
    ]
    found = score(tied, one)
    assert (found["tie"], found["covered"], found["covered_in_ties"]) == (3, {}, {"a": True})
    assert found["coefficients_covered"] == {"m": False, "n": True}
    assert score(tied, truth("one", {"d": 2.0}))["coefficients_covered"] == {}
    assert score(said("named", {"a": [1, 3]}), one)["tie"] == 1
    assert score(said("none"), one)["tie"] is None
    pair = said("tied", {"effects.current.north": [1, 3]}, [["effects.current.north", "effects.current.east", "b"]])
    assert score(pair, one)["tie"] == 2  # its two components are one current
    lumped = said("tied", {"a": [3, 4]}, [["a", "k"]])
    assert score(lumped, one)["covered"] == {}  # the size includes the error of k


def test_a_wrong_coefficient_is_no_false_name_of_an_effect():
    wrong = truth("none_wrong", wrong={"hull.n_delta": [1.0, 1.1]})
    twin = said("tied", {"effects.rudder.gain": [0.8, 0.95]}, [["effects.rudder.gain", "hull.n_delta"]])
    assert (score(twin, wrong)["right"], score(twin, wrong)["covered"]) == (True, {})
    assert score(twin, truth("none"))["false"] == ["effects.rudder.gain"]
    found = score(said("none", coefficients_wrong=["hull.n_delta", "hull.n_r"]), wrong)
    assert found["coefficients_found"] == ["hull.n_delta"]
    assert found["coefficients_false"] == ["hull.n_r"]
    assert not score(said("unexplained"), truth("none"))["right"]


def test_a_cause_outside_the_library_wants_a_flag_or_a_term_that_holds():
    outside = truth("outside", cause="drag")
    flagged = score(said("unexplained", {"b": [0, 1]}), outside)
    assert (flagged["right"], flagged["confident"]) == (True, False)
    sure = score(said("named", {"b": [0, 1]}), outside)
    assert (sure["right"], sure["confident"]) == (False, True)
    helped = score(said("named", {"b": [0, 1]}, discovered={"holds": True}), outside)
    assert (helped["right"], helped["confident"]) == (True, False)
    assert not score(said("none"), outside)["right"]


def test_the_true_vehicle_is_as_good_as_itself_in_the_parts_of_a_diagnosis():
    plant = load_vehicle("slocum")
    record = log_of(plant, QUIET, 3)
    windows = [w for part in parts_of(plant, record, 5) for w in windows_of(record, part, 60.0)]
    scores = free_runs(plant, record, sorted(windows, key=lambda w: w.start), 12.0).scores(record)
    own = {name: {"rmse": s.rmse} for name, s in scores.items()}
    twice = {name: {"rmse": 2.0 * s.rmse} for name, s in scores.items()}
    assert error_ratio(own, record, plant, 5, 60.0, 12.0) == pytest.approx(1.0)
    assert error_ratio(twice, record, plant, 5, 60.0, 12.0) == pytest.approx(2.0)


def test_shares_come_with_their_exact_intervals():
    low, high = exact_interval(9, 10)
    assert low == pytest.approx(0.5550, abs=1e-4)  # Clopper and Pearson, as in tables of the binomial
    assert high == pytest.approx(0.9975, abs=1e-4)
    assert exact_interval(10, 10) == (pytest.approx(0.025**0.1), 1.0)
    assert exact_interval(0, 0) == (0.0, 1.0)
    rows = [score(said("none"), truth("none"), 1.1), score(said("named", {"b": [0, 1]}), truth("none"), 1.4)]
    found = summary(rows)["none"]["glider"]
    assert (found["right"]["hits"], found["false"]["hits"], found["within"]["hits"]) == (1, 1, 1)
    assert found["ratio"]["most"] == 1.4
    assert (found["named"]["hits"], found["tie"]["median"]) == (1, 1.0)
    wide = score(said("tied", {"b": [0, 1]}, [["b", "c", "d", "e"]]), truth("none"), fresh=0.9)
    found = summary([*rows, wide])["none"]["glider"]
    assert (found["wide"]["hits"], found["wide"]["count"], found["fresh"]["median"]) == (1, 2, 0.9)


@pytest.mark.slow
@pytest.mark.parametrize("number", [23, pytest.param(25, marks=pytest.mark.slow)])
def test_effects_of_a_short_draw_are_named(tmp_path, number):
    case = sketch(1, number)
    assert (case.kind, case.vehicle) == ("one", "slocum")
    log = seal(draw(case), tmp_path)
    found = score_folders(log, truth_folder(tmp_path, number), diagnose_folder(log))
    assert found["right"]
    assert found["false"] == []
    assert found["ratio"] < 1.15


def test_the_program_diagnoses_in_a_process_of_its_own_and_resumes(tmp_path, capsys):
    out = tmp_path / "all.json"
    arguments = ["--cases", "1", "--seed", "1", "--family", "glider", "--kind", "none", "--jobs", "1"]
    assert main([*arguments, "--out", str(tmp_path), "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "nothing missing" in printed
    assert "95 % intervals that hold the truth" in printed
    content = json.loads(out.read_text())
    (row,) = content["scores"]
    assert row["right"]
    assert 0.5 < row["fresh"] < 2.0
    assert all(row["coefficients_covered"].values())
    assert content["shares"]["all"]["glider"]["right"]["count"] == 1
    kept = log_folder(tmp_path / "seed_1", row["number"]) / "diagnosis.json"
    kept.write_text(json.dumps({"verdict": "unexplained"}))
    assert run_case(sketch(1, row["number"]), tmp_path / "seed_1")["verdict"] == "unexplained"
    with pytest.raises(ValueError, match="another folder"):
        run_case(sketch(1, row["number"], sampling=REALISTIC), tmp_path / "seed_1")


def test_a_diagnosis_that_takes_too_long_is_a_miss(tmp_path):
    case = chosen(1, 1, ["none"], ["glider"])[0]
    found = run_case(case, tmp_path, timeout=0.05)
    assert (found["verdict"], found["right"], found["seconds"]) == ("timeout", False, None)


@pytest.mark.slow
def test_the_benchmark_is_mostly_right_about_gliders_and_floats(tmp_path):
    out = tmp_path / "all.json"
    families = ["--family", "glider", "--family", "float"]
    assert main(["--cases", "30", "--seed", "2", *families, "--out", str(tmp_path), "--json", str(out)]) == 0
    shares = json.loads(out.read_text())["shares"]
    assert shares["one"]["all"]["right"]["share"] >= 0.8
    assert shares["none"]["all"]["false"]["share"] <= 0.1


def test_logs_of_vehicles_with_thrusters_are_drawn_when_they_are_asked_for():
    assert {c.family for c in chosen(7, 60, None, None)} == {"glider", "float", "torpedo"}
    cases = chosen(41, 6, ["one"], ["rov", "rov_attitude"])
    assert {c.family for c in cases} == {"rov", "rov_attitude"}
    assert all(c.conditions.measured == ("attitude" if c.family == "rov_attitude" else "all") for c in cases)
    plant = load_vehicle("bluerov2_heavy")
    attitude = {"roll_rad", "pitch_rad", "heading_rad", "p_radps", "q_radps", "r_radps"}
    alone = log_of(plant, Conditions(1.0, 1.0, 5.0, "attitude"), 0)
    assert set(alone.names) == attitude | {f"t{k}_share" for k in range(1, 9)}
    whole = log_of(plant, Conditions(1.0, 1.0, 5.0), 0)
    assert attitude | {"u_mps", "north_m", "depth_m", "heading_cmd_rad"} <= set(whole.names)
    assert not any(name.startswith("excitation") or name.endswith("_Nm") for name in whole.names)


def test_water_that_rises_ends_a_dive_at_the_surface():
    depth = np.array([1.0, 20.0, 40.0, 20.0, 5.0, 1.0])
    time = 10.0 * np.arange(12)
    dives = Record.from_arrays(time, {"depth_m": np.r_[depth, depth]}, segment=np.repeat([0, 1], 6))
    moved = heaved(dives, np.full(12, -0.05))
    assert [part.stop - part.start for part in moved.segments] == [5, 5]
    assert moved["depth_m"].tolist() == pytest.approx([1.0, 19.5, 39.0, 18.5, 3.0] * 2)
    assert heaved(dives, np.full(12, 0.05))["depth_m"][-1] == pytest.approx(3.5)
