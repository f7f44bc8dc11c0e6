"""Sizes and intervals in words."""

import pytest

from identification.diagnosis.wording import ends, inside, quantity


@pytest.mark.parametrize(
    "value, limits, unit, words",
    [
        (5.9917e-5, (5.9915e-5, 5.9920e-5), "m^3", ("59.92 mL", "59.91", "59.92 mL")),
        (1.9854, (1.9851, 1.9862), "s", ("1.985 s", "1.985", "1.986 s")),
        (0.9, (0.85, 0.95), "1", ("0.9", "0.85", "0.95")),
        (3.0, (3.0, 3.0), "m", ("3 m", "3", "3 m")),
    ],
)
def test_a_size_has_as_many_figures_as_the_ends_of_its_interval(value, limits, unit, words):
    assert (inside(value, limits, unit), *ends(limits, unit)) == words


@pytest.mark.parametrize(
    "value, figures, text", [(150.0, 2, "150 kg"), (1.5, 2, "1.5 kg"), (1234.6, 3, "1235 kg"), (2e6, 3, "2e+06 kg")]
)
def test_numbers_of_usual_size_have_no_exponent(value, figures, text):
    assert quantity(value, "kg", figures) == text
