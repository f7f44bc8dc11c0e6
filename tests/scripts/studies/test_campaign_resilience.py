import pytest

from scripts.studies.campaign_resilience import STUDY


def test_too_few_runs_are_refused(capsys):
    assert STUDY.main(["--runs", "2"]) == 1
    assert "--runs needs 4 or more, got 2" in capsys.readouterr().err


@pytest.mark.slow
def test_kills_and_clusters_leave_the_same_records():
    found = STUDY.find([0], runs=10, duration=40.0)
    assert STUDY.good(found)
    killed, clustered = found.of("kill")[0], found.of("dask")[0]
    assert killed["kept"] == killed["after"] < 10
    assert 5 <= clustered["killed_after"] < 10
    assert clustered["exit_code"] == 0
