import os

import pytest

from identification.campaign.running.pool import in_parallel


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
