"""Tests of running campaigns: the contents of the folder after any interruption or failure."""

import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from auv_gym.channels import channel
from auv_gym.model import Diverged
from auv_gym.records.record import Record
from identification.campaign.file.plan import plan
from identification.campaign.file.reading import read_campaign
from identification.campaign.file.settings import RunSettings
from identification.campaign.index import read_index, rows_from_run_files, run_file
from identification.campaign.running import conduct as conducting
from identification.campaign.running.conduct import conduct
from identification.campaign.running.perform import Outcome, content_hash, perform
from tests.identification.campaign.texts import DEEP

TEXT = """
name = "short"
seeds = 2
[vehicle]
preset = "slocum"
[experiment]
kind = "env"
id = "GliderHeading"
duration_s = 80.0
compass_noise_rad = 0.01
[controller]
kind = "pid"
[[excitation]]
kind = "prbs"
at = "rudder_rad"
amplitude = 0.1
clock_s = 8.0
[grid]
vehicle.effects.rudder.offset = [0.0, 0.05]
"""


@pytest.fixture
def campaign(tmp_path):
    path = tmp_path / "short.toml"
    path.write_text(TEXT)
    return read_campaign(path)


def changed(campaign, old, new):
    assert old in campaign.text
    path = campaign.path.with_name("changed.toml")
    path.write_text(campaign.text.replace(old, new))
    return read_campaign(path)


def numbers(folder):
    return {row.id: row.sha256 for row in read_index(folder)}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The hashes of a campaign that nothing disturbed."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "short.toml").write_text(TEXT)
    conduct(read_campaign(folder / "short.toml"), folder / "out")
    return numbers(folder / "out")


def test_a_run_is_a_record_with_all_that_it_was_made_of(campaign, tmp_path):
    told = []
    result = conduct(campaign, tmp_path / "out", progress=lambda *facts: told.append(facts))
    assert [row.status for row in result.rows] == ["done"] * 4
    assert result.failures == []
    assert told[-1] == (4, 4, 0, "running")
    assert read_index(tmp_path / "out") == list(result.rows)
    row = result.rows[2]
    assert row.cell == {"vehicle.effects.rudder.offset": 0.05}
    assert row.samples == 21
    assert row.duration_s == 80.0
    record = Record.load(row.path(tmp_path / "out"))
    assert {"heading_rad", "rudder_rad", "heading_cmd_rad", "excitation_rudder_rad", "heading_true_rad"} <= set(
        record.names
    )
    assert all(record.dataset[name].attrs["units"] == channel(name).unit for name in record.names)
    assert content_hash(record) == row.sha256
    settings = RunSettings.model_validate_json(record.attrs["settings"])
    assert settings == plan(campaign)[2].settings
    assert "numba" in record.attrs["versions"]
    assert record.attrs["seed"] == 0
    assert np.std(record["heading_rad"] - record["heading_true_rad"]) == pytest.approx(0.01, rel=0.5)
    assert np.abs(record["excitation_rudder_rad"]).max() == pytest.approx(0.1)
    assert (tmp_path / "out" / "campaign.toml").read_text() == campaign.text


def test_a_run_is_the_same_wherever_it_is_performed(campaign, whole):
    run = plan(campaign)[1]
    assert perform(run).sha256 == perform(run).sha256 == whole[run.id]


def test_what_is_there_is_kept_and_what_is_not_is_done(campaign, tmp_path, whole, monkeypatch):
    out = tmp_path / "out"
    conduct(campaign, out)
    first, second, third, fourth = (row.path(out) for row in read_index(out))
    before = fourth.stat().st_mtime_ns
    first.unlink()
    second.write_bytes(second.read_bytes()[:1000])  # cut short by a full disk, say
    other = Record.load(third)
    other.with_channels({"heading_rad": other["heading_rad"] + 1.0}).save(third)  # not what was written
    (out / "runs" / ".x.nc.1234.part").write_bytes(b"half")
    (out / "index.csv").write_text("nonsense\n1,2\n")
    performed = []
    monkeypatch.setattr(
        "identification.campaign.running.workers.perform",
        lambda run, folder=None: performed.append(run.id) or perform(run, folder),
    )
    (out / "index.csv").unlink()
    result = conduct(campaign, out)
    assert performed == [path.stem for path in (first, second, third)]
    assert result.kept == 1
    assert numbers(out) == whole
    assert fourth.stat().st_mtime_ns == before
    assert not list((out / "runs").glob(".*.part"))
    assert conduct(campaign, out).kept == 4
    assert len(performed) == 3


def test_a_changed_file_keeps_the_old_records_and_says_so(campaign, tmp_path):
    out = tmp_path / "out"
    conduct(campaign, out)
    result = conduct(changed(campaign, "seeds = 2", "seeds = [0, 5]"), out)
    assert result.kept == 2
    assert len(result.strangers) == 2
    assert all(path.is_file() for path in result.strangers)
    assert [row.seed for row in read_index(out)] == [0, 5, 0, 5]


def test_what_cannot_be_is_found_before_anything_runs(campaign, tmp_path, monkeypatch):
    monkeypatch.setattr(conducting, "_outcomes", lambda *given: pytest.fail("a run was begun"))
    wrong = [
        ('at = "rudder_rad"', 'at = "ruder_rad"', r"excitation.0.at needs .*rudder_rad.*got 'ruder_rad'"),
        ('kind = "prbs"', 'kind = "prsb"', r"excitation.0.kind: no 'prsb'. Did you mean 'prbs'"),
        ('kind = "prbs"', 'kind = "relay"', "excitation.0: a relay needs amplitude, measured and band"),
        ("clock_s", "clock", "excitation.0: Signal 'prbs' has no setting 'clock'"),
        ('kind = "pid"', 'kind = "pid"\nfoo = 1', "controller: kind 'pid' does not take"),
        ('preset = "slocum"', 'preset = "slocom"', "Did you mean 'slocum'"),
        ('id = "GliderHeading"', 'id = "Glider"', "experiment.id"),
        (
            "duration_s = 80.0",
            "duration_s = 80.0\nnear = [1.0, 2.0]",
            "has no option 'near' for slocum",
        ),
        ("rudder.offset", "ruder.offset", "No parameter 'effects.ruder.offset'"),
        ("[0.0, 0.05]", "[0.0, 5.0]", "with vehicle.effects.rudder.offset = 5.0: effects.rudder.offset needs a value"),
        ("duration_s = 80.0", "duration_s = 80.0\ntargets = { heading_rad = [[5, 0.0]] }", "the first at 0 s"),
    ]
    for old, new, said in wrong:
        with pytest.raises(ValueError, match=said):
            conduct(changed(campaign, old, new), tmp_path / "out")


@pytest.mark.parametrize(
    "old, new, said",
    [
        ('"arx"', '"arks"', "fit 'line': No method 'arks'. Methods: "),
        ("n_a = 2", "na = 2", "fit 'line': Method arx has no setting 'na'"),
        (
            '"rudder_rad"]',
            '"ruder_rad"]',
            "fit 'line': No run of slocum has a channel 'ruder_rad'. Did you mean 'rudder_rad'",
        ),
    ],
)
def test_a_fit_that_cannot_be_made_is_found_before_anything_runs(campaign, tmp_path, monkeypatch, old, new, said):
    monkeypatch.setattr(conducting, "_outcomes", lambda *given: pytest.fail("a run was begun"))
    fit = """
[[fit]]
name = "line"
method = "arx"
settings = { n_a = 2 }
inputs = ["rudder_rad"]
outputs = ["heading_rad"]
"""
    campaign.path.write_text(TEXT + fit.replace(old, new))
    with pytest.raises(ValueError, match=said):
        conduct(read_campaign(campaign.path), tmp_path / "out")


def test_targets_that_nothing_follows_are_found_before_anything_runs(campaign, tmp_path):
    lost = changed(campaign, "duration_s = 80.0", "duration_s = 80.0\ntargets = { heading_deg = [[0, 30]] }")
    with pytest.raises(
        ValueError, match=r"changed\.toml.*experiment\.targets: .* target of 'heading_deg'. Did you mean"
    ):
        conduct(lost, tmp_path / "out")


def test_a_zigzag_switches_as_the_vehicle_answers(campaign, tmp_path):
    short = changed(campaign, 'kind = "prbs"', 'kind = "zigzag"\nband = 0.05')
    short = changed(short, "clock_s = 8.0\n", "")
    row = conduct(short, tmp_path / "out").rows[0]
    assert row.status == "done"
    record = Record.load(row.path(tmp_path / "out"))
    rudder = record["rudder_rad"]
    assert set(np.round(rudder, 12)) == {-0.1, 0.1}
    switched = np.flatnonzero(np.diff(rudder)) + 1
    away = record["heading_rad"][switched] - record["heading_rad"][0]
    assert switched.size >= 1
    assert (np.sign(rudder[switched]) * away <= -0.05).all()


def test_runs_that_fail_leave_the_others_alone(campaign, tmp_path, monkeypatch):
    runs = plan(campaign)

    def broken(run, folder=None):
        if run.id == runs[0].id:
            monkeypatch.setattr(
                "identification.campaign.running.perform.drive", _raises(Diverged(3.0, "heading_rad", {}))
            )
        elif run.id == runs[1].id:
            monkeypatch.setattr("identification.campaign.running.perform.drive", _raises(ZeroDivisionError("by zero")))
        else:
            monkeypatch.undo()
        return perform(run, folder)

    monkeypatch.setattr("identification.campaign.running.workers.perform", broken)
    result = conduct(campaign, tmp_path / "out")
    assert [row.status for row in result.rows] == ["diverged", "failed", "done", "done"]
    assert "heading_rad is not finite at 3.000 s" in result.rows[0].reason
    assert "ZeroDivisionError in test_conduct.py" in result.rows[1].reason
    # without a record they are tried again
    assert [row.status for row in conduct(campaign, tmp_path / "out").rows] == ["done"] * 4


def _raises(error):
    def drive(*given, **named):
        raise error

    return drive


def test_a_run_that_leaves_its_envelope_keeps_its_record(tmp_path):
    (tmp_path / "deep.toml").write_text(DEEP)
    result = conduct(read_campaign(tmp_path / "deep.toml"), tmp_path / "out")
    assert [row.status for row in result.rows] == ["ended"]
    assert "too deep" in result.rows[0].reason
    assert result.failures == list(result.rows)
    record = Record.load(result.rows[0].path(tmp_path / "out"))
    assert record["depth_m"].max() < 42.0
    assert conduct(read_campaign(tmp_path / "deep.toml"), tmp_path / "out").kept == 1


def test_a_full_disk_costs_the_runs_that_do_not_fit(campaign, tmp_path, monkeypatch, whole):
    real, out = conducting.replacing, tmp_path / "out"

    def full(path):
        if "runs" in str(path) and len(list((out / "runs").glob("*.nc"))) >= 2:
            raise ValueError(f"Cannot write {path}: No space left on device.")
        return real(path)

    monkeypatch.setattr(conducting, "replacing", full)
    result = conduct(campaign, out)
    assert [row.status for row in result.rows] == ["done", "done", "failed", "failed"]
    assert "No space left" in result.rows[3].reason
    monkeypatch.undo()
    conduct(campaign, out)
    assert numbers(out) == whole


def test_a_folder_that_cannot_be_written_is_refused(campaign, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="Cannot write into"):
        conduct(campaign, tmp_path / "file" / "out")


def test_two_processes_do_not_share_a_folder(campaign, tmp_path):
    (tmp_path / "out").mkdir()
    with conducting._alone(tmp_path / "out"), pytest.raises(ValueError, match="Another process"):
        conduct(campaign, tmp_path / "out")


def test_missions_and_logs_are_runs_too(campaign, tmp_path):
    first = conduct(campaign, tmp_path / "out").rows[0]
    run_file(tmp_path / "out", first.id).rename(tmp_path / "log.nc")
    texts = {
        "mission": '[vehicle]\npreset = "slocum"\n[experiment]\nkind = "mission"\nduration = 100.0\n',
        "log": '[experiment]\nkind = "log"\nfile = "log.nc"\n',
    }
    for kind, text in texts.items():
        path = tmp_path / f"{kind}.toml"
        path.write_text(f'name = "{kind}"\n{text}')
        result = conduct(read_campaign(path), tmp_path / kind)
        assert [row.status for row in result.rows] == ["done"]
        assert Record.load(result.rows[0].path(tmp_path / kind)).has("heading_rad")
    assert result.rows[0].sha256 == first.sha256
    path.write_text(path.read_text().replace('kind = "log"', 'kind = "mission"\nduraton = 3'))
    with pytest.raises(ValueError):
        conduct(read_campaign(path), tmp_path / "wrong")


@pytest.mark.slow
def test_a_cluster_performs_the_same_runs(campaign, tmp_path, whole):
    distributed = pytest.importorskip("distributed")
    out = tmp_path / "out"
    with distributed.LocalCluster(2, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        conduct(campaign, out, scheduler=cluster.scheduler_address)
    assert numbers(out) == whole


@pytest.mark.slow
def test_a_killed_campaign_goes_on_where_it_was(campaign, tmp_path, whole):
    out = tmp_path / "out"
    for blow, code in ((signal.SIGKILL, -signal.SIGKILL), (signal.SIGTERM, 130)):
        slow = "import auv_gym.cli, identification.campaign.running.workers as w, time, sys\nreal = w.perform\n"
        slow += "def perform(run, folder=None):\n    time.sleep(0.5)\n    return real(run, folder)\n"
        slow += "w.perform = perform\nsys.exit(auv_gym.cli.main(sys.argv[1:]))\n"
        options = ["campaign", str(campaign.path), "--out", str(out), "--only", "runs", "--jobs", "1"]
        process = subprocess.Popen([sys.executable, "-c", slow, *options], stderr=subprocess.PIPE, text=True)
        had = len(list((out / "runs").glob("*.nc")))
        deadline = time.monotonic() + 60.0
        while len(list((out / "runs").glob("*.nc"))) == had and time.monotonic() < deadline:
            time.sleep(0.02)
        process.send_signal(blow)
        _, said = process.communicate(timeout=60)
        assert process.returncode == code, said
    assert "the same command resumes it" in said
    left = {row.status for row in read_index(out)}
    assert left == {"done", "pending"}  # the polite end wrote the index
    times = {path: path.stat().st_mtime_ns for path in (out / "runs").glob("*.nc")}
    assert 2 <= len(times) < 4
    assert conduct(campaign, out).kept == len(times)
    assert numbers(out) == whole
    assert all(path.stat().st_mtime_ns == then for path, then in times.items())
    assert [row.status for row in rows_from_run_files(plan(campaign), out)] == ["done"] * 4
    assert isinstance(perform(plan(campaign)[0]), Outcome)
