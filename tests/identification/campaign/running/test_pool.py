import os

import pytest

from identification.campaign.running.pool import in_parallel, on_cluster


def squared(number):
    if number == 2:
        os._exit(9)
    return number**2


def test_a_process_that_dies_costs_its_own_task_only():
    assert dict(in_parallel(squared, range(6), 2)) == {0: 0, 1: 1, 2: None, 3: 9, 4: 16, 5: 25}


def test_one_job_needs_no_other_process():
    assert list(in_parallel(lambda task: (task, os.getpid()), [3, 4], 1)) == [
        (0, (3, os.getpid())),
        (1, (4, os.getpid())),
    ]
    assert list(in_parallel(squared, [], 2)) == []


def test_errors_come_through():
    with pytest.raises(ZeroDivisionError):
        list(in_parallel(lambda task: 1 / task, [1, 0], 2))


def tenth(number):
    return 1 / number


def test_a_cluster_gives_results_and_errors_in_their_place():
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster,
        on_cluster(cluster.scheduler_address) as spread,
    ):
        found = dict(spread(tenth, [1, 0, 4]))
    assert (found[0], found[2]) == (1.0, 0.25)
    assert isinstance(found[1], ZeroDivisionError)
