import json

import pytest

from scripts.campaign_resilience import main


def test_too_few_runs_are_refused():
    with pytest.raises(ValueError, match="--runs needs 4"):
        main(["--runs", "2"])


@pytest.mark.slow
def test_kills_and_clusters_leave_the_same_records(capsys):
    assert main(["--runs", "10", "--duration", "40", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["two_jobs_same"]
    assert found["kill_same"]
    assert found["dask_same"]
    assert found["kill_kept"] == found["kill_after"] < 10
    assert 5 <= found["dask_killed_after"] < 10
    assert found["dask_exit_code"] == 0
    assert found["dask_twice"] == 0
