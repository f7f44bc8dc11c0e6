import pytest

from auv_gym.plant import load_vehicle, save_vehicle
from identification.campaign.file.plan import plan, selected
from identification.campaign.file.reading import read_campaign, with_value
from identification.campaign.file.settings import EnvExperiment

GOOD = """
name = "trial"
seeds = [4, 7]

[vehicle]
preset = "slocum"
effects.rudder.offset = 0.02

[experiment]
kind = "env"
id = "GliderHeading"
duration_s = 100.0
targets = { heading_rad = [[0, 0.0], [50, 0.5]] }

[controller]
kind = "pid"

[[excitation]]
kind = "prbs"
at = "rudder_rad"
amplitude = 0.1
clock_s = 8.0

[envelope]
heading_rad = [-3.0, 3.0]
lookahead = 3.0

[grid]
vehicle.dt_s = [2.0, 4.0]
"excitation.0.amplitude" = [0.1, 0.2]

[[fit]]
name = "first"
method = "arx"
runs = { seeds = 4 }
validate = { seeds = [7], "vehicle.dt_s" = 4.0 }
each = ["vehicle.dt_s"]

[compare]
closed_loop = true
"""


@pytest.fixture
def write(tmp_path):
    def written(text=GOOD, *changes):
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / "trial.toml"
        path.write_text(text)
        return path

    return written


def test_a_campaign_is_its_grid_times_its_seeds(write):
    campaign = read_campaign(write())
    runs = plan(campaign)
    assert len(runs) == 2 * 2 * 2
    assert [run.seed for run in runs[:2]] == [4, 7]
    assert runs[0].cell == {"vehicle.dt_s": 2.0, "excitation.0.amplitude": 0.1}
    assert runs[-1].settings.vehicle.dt_s == 4.0
    assert runs[-1].settings.excitation[0].settings == {"amplitude": 0.2, "clock_s": 8.0}
    assert runs[0].settings.vehicle.effects == {"effects.rudder.offset": 0.02}
    assert isinstance(runs[0].settings.experiment, EnvExperiment)
    assert runs[0].settings.experiment.env_id == "auv_gym/GliderHeading-v0"
    assert runs[0].settings.envelope.limits == {"heading_rad": (-3.0, 3.0)}
    assert runs[0].settings.envelope.options == {"lookahead": 3.0}
    assert len({run.id for run in runs}) == len(runs)
    assert campaign.compare.closed_loop
    assert campaign.fit[0].validate_on == {"seeds": [7], "vehicle.dt_s": 4.0}


def test_ids_follow_what_a_run_depends_on_and_nothing_else(write, tmp_path):
    ids = [run.id for run in plan(read_campaign(write()))]
    renamed = write(GOOD, ('name = "trial"', 'name = "other"'), ("seeds = [4, 7]", "seeds = [7, 4]"))
    assert {run.id for run in plan(read_campaign(renamed))} == set(ids)
    same = write(GOOD, ("effects.rudder.offset = 0.02", '[vehicle.effects]\n"effects.rudder.offset" = 0.02\n'))
    assert [run.id for run in plan(read_campaign(same))] == ids
    other = write(GOOD, ("0.02", "0.03"))
    assert not {run.id for run in plan(read_campaign(other))} & set(ids)
    # the content of a file counts, its name alone does not say what will be run
    in_file = write(GOOD, ('preset = "slocum"', 'file = "mine.toml"'))
    save_vehicle(load_vehicle("slocum"), tmp_path / "mine.toml")
    first = [run.id for run in plan(read_campaign(in_file))]
    save_vehicle(load_vehicle("slocum", dt=2.0), tmp_path / "mine.toml")
    second = plan(read_campaign(in_file))
    assert not {run.id for run in second} & set(first)
    assert b"slocum" in second[0].files["mine.toml"]


def test_seeds_may_be_counted_and_moved(write):
    counted = write(GOOD, ("seeds = [4, 7]", "seeds = 3"), ("{ seeds = 4 }", "{}"), ("seeds = [7], ", ""))
    assert read_campaign(counted).seeds == (0, 1, 2)
    assert read_campaign(counted, seed_offset=10).seeds == (10, 11, 12)
    with pytest.raises(ValueError, match="begin below 0"):
        read_campaign(counted, seed_offset=-1)


def test_filters_choose_by_seed_and_by_grid(write):
    runs = plan(read_campaign(write()))
    assert len(selected(runs, {})) == 8
    assert len(selected(runs, {"seeds": 4})) == 4
    assert {run.cell["excitation.0.amplitude"] for run in selected(runs, {"excitation.0.amplitude": [0.2]})} == {0.2}
    assert selected(runs, {"seeds": [4], "vehicle.dt_s": 2.0, "excitation.0.amplitude": 0.1}) == [runs[0]]


def test_a_value_goes_to_the_key_with_dots():
    content = {"vehicle": {"effects": {"rudder.offset": 0.1}}, "excitation": [{"amplitude": 1.0}]}
    assert with_value(content, "vehicle.effects.rudder.offset", 0.2)["vehicle"]["effects"] == {"rudder.offset": 0.2}
    assert with_value(content, "excitation.0.amplitude", 2.0)["excitation"][0]["amplitude"] == 2.0
    assert with_value(content, "sensors.depth.noise", 0.3)["sensors"] == {"depth.noise": 0.3}
    assert with_value(content, "experiment.duration_s", 9.0)["experiment"] == {"duration_s": 9.0}
    assert content["excitation"][0]["amplitude"] == 1.0


WRONG = [
    (("seeds = [4, 7]", "sedes = 3"), "unknown key 'sedes'. Did you mean 'seeds'"),
    (('preset = "slocum"', 'presett = "slocum"'), "vehicle.presett: unknown key. Did you mean 'preset'"),
    (('preset = "slocum"', 'preset = "slocum"\nfile = "x.toml"'), "vehicle: needs either preset or file"),
    (('preset = "slocum"', "preset = 3"), "vehicle.preset needs text in quotes, got 3"),
    (("effects.rudder.offset = 0.02", 'effects.rudder.offset = "much"'), "rudder.offset needs a number, got 'much'"),
    (('kind = "env"', 'kind = "emv"'), "experiment.kind needs one of 'env', 'mission', 'log', got 'emv'"),
    (('kind = "env"\n', ""), "experiment.kind is missing: give one of 'env', 'mission', 'log'"),
    (("duration_s = 100.0", "duration = 100.0"), "experiment.duration: unknown key. Did you mean 'duration_s'"),
    (("duration_s = 100.0", "duration_s = -1.0"), "experiment.duration_s needs a number above 0, got -1"),
    (("duration_s = 100.0", "duration_s = true"), "experiment.duration_s needs a number, got True"),
    (("duration_s = 100.0", "duration_s = inf"), "experiment.duration_s needs a finite number"),
    (("[[0, 0.0], [50, 0.5]]", '"drwan"'), "experiment.targets.heading_rad needs 'drawn' or a list, got 'drwan'"),
    (("[[0, 0.0], [50, 0.5]]", "[[0, 0.0, 1]]"), "experiment.targets.heading_rad.0 needs no more than 2 items"),
    (('kind = "pid"', 'kind = "pdi"'), "controller.kind needs 'pid', 's_plane' or 'gpc', got 'pdi'"),
    (('[controller]\nkind = "pid"\n', ""), "needs a table [controller]"),
    (('at = "rudder_rad"\n', ""), "excitation.0.at is missing"),
    (("[-3.0, 3.0]", "[3.0, -3.0]"), "envelope: heading_rad needs a pair [low, high] of numbers"),
    (("heading_rad = [-3.0, 3.0]\n", ""), "envelope: needs limits"),
    (("vehicle.dt_s = [2.0, 4.0]", "vehicle.dt = [2.0, 4.0]"), "vehicle.dt = 2.0"),
    (("vehicle.dt_s = [2.0, 4.0]", "vehicle.dt_s = 2.0"), "grid.vehicle.dt_s needs a list, got 2.0"),
    (("vehicle.dt_s = [2.0, 4.0]", "vehicle.dt_s = [2.0, 2.0]"), "names the same run twice"),
    (('"excitation.0.amplitude"', '"excitation.3.amplitude"'), "needs a number from 0 to 0 after 'excitation'"),
    (('method = "arx"\n', ""), "fit.0.method is missing"),
    (("runs = { seeds = 4 }", "runs = { seed = 4 }"), "runs has no key 'seed'. Did you mean 'seeds'"),
    (("runs = { seeds = 4 }", "runs = { seeds = 5 }"), "seeds is 4 or 7, got 5"),
    (('each = ["vehicle.dt_s"]', 'each = ["vehicle.dt"]'), "each has no key 'vehicle.dt'"),
    (('name = "first"', 'name = "a/b"'), "names need letters"),
    (("seeds = [4, 7]", "seeds = [4, 4]"), "seeds names a seed twice"),
    (("seeds = [4, 7]", "seeds = [4, -7]"), "seeds.1 needs a number of at least 0, got -7"),
    (("closed_loop = true", 'closed_loop = "yes"'), "compare.closed_loop needs true or false, got 'yes'"),
    (("[compare]", "[compare"), "not valid TOML"),
    (('preset = "slocum"', 'file = "none.toml"'), "none.toml: No such file"),
]


@pytest.mark.parametrize("change, said", WRONG, ids=[said[:40] for _, said in WRONG])
def test_what_is_wrong_is_said_with_its_key(write, change, said):
    with pytest.raises(ValueError) as raised:
        plan(read_campaign(write(GOOD, change)))
    assert said in str(raised.value)
    assert "trial.toml" in str(raised.value) or "none.toml" in str(raised.value)


def test_a_mission_takes_no_controller(write):
    text = GOOD.replace('kind = "env"\nid = "GliderHeading"', 'kind = "mission"').replace("duration_s", "duration")
    with pytest.raises(ValueError, match="controller is for experiments of kind 'env'"):
        plan(read_campaign(write(text)))


def test_every_problem_has_a_line(write):
    with pytest.raises(ValueError) as raised:
        plan(read_campaign(write(GOOD, ("duration_s", "duration"), ('preset = "slocum"', 'preset = "slocum"\nx = 1'))))
    assert len(str(raised.value).splitlines()) == 2
    assert "vehicle.x" in str(raised.value)


def test_filters_by_seed_move_with_the_seeds(tmp_path):
    path = tmp_path / "moved.toml"
    path.write_text(
        'name = "moved"\nseeds = [1, 2]\n[experiment]\nkind = "env"\nid = "GliderHeading"\n[controller]\n'
        '[[fit]]\nname = "a"\nmethod = "arx"\nruns = { seeds = 1 }\nvalidate = { seeds = [2] }\n'
        '[[fit]]\nname = "b"\nmethod = "arx"\n[compare]\nruns = { seeds = [1, 2] }\n'
    )
    campaign = read_campaign(path, seed_offset=10)
    assert campaign.seeds == (11, 12)
    assert campaign.fit[0].runs == {"seeds": [11]}
    assert campaign.fit[0].validate_on == {"seeds": [12]}
    assert campaign.fit[1].runs == {}
    assert campaign.fit[1].validate_on is None
    assert campaign.compare.runs == {"seeds": [11, 12]}
