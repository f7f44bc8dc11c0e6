"""Intervals of estimates."""

import pytest

from identification.estimate import half_width


def test_an_interval_of_few_degrees_of_freedom_is_students():
    assert [half_width(n) for n in (3, 10)] == pytest.approx([3.1824, 2.2281], abs=1e-4)  # from tables
