"""The terms of the hull polynomials: their units and words follow from their names."""

import re

import pytest

from auv_gym.param import list_paths, spec_at
from auv_gym.physics.polynomials import (
    ENVIRONMENT_TERMS,
    TERMS,
    DiscoveredForce,
    DiscoveredMoment,
    ForceTerms,
    MomentTerms,
    unit,
    words,
)

# exponents of kg, m, s
SPEED, RATE, FORCE, MOMENT = (0, 1, -1), (0, 0, -1), (1, 1, -2), (1, 2, -2)


def dimension(text: str) -> tuple[int, ...]:
    """Exponents of kg, m and s in a unit such as `kg m^2/s`; N is kg m/s^2, and angles are numbers."""
    total = [0, 0, 0]
    for part, sign in zip(text.split("/"), (1, -1), strict=False):
        for symbol, power in re.findall(r"(kg|m|s|N)(?:\^(\d+))?", part):
            base = {"kg": (1, 0, 0), "m": (0, 1, 0), "s": (0, 0, 1), "N": FORCE}[symbol]
            total = [t + sign * int(power or 1) * b for t, b in zip(total, base, strict=True)]
    return tuple(total)


def term_dimension(term: str) -> tuple[int, ...]:
    if term in ENVIRONMENT_TERMS:
        return (0, 1, 0) if term == "depth" else (0, 0, 0)
    factors = [SPEED if symbol in "uvw" else RATE for symbol in term.replace("_", "")]
    return tuple(map(sum, zip(*factors, strict=True)))


@pytest.mark.parametrize("term", [*TERMS, *ENVIRONMENT_TERMS])
def test_a_coefficient_times_its_term_is_a_force_or_a_moment(term):
    for moment, whole in ((False, FORCE), (True, MOMENT)):
        found = map(sum, zip(dimension(unit(term, moment)), term_dimension(term), strict=True))
        assert tuple(found) == whole


@pytest.mark.parametrize(
    "term, expected",
    [("uv", "u v"), ("v_v", "v |v|"), ("vv", "v v"), ("r", "r"), ("sin_heading", "sin heading"), ("depth", "depth")],
)
def test_a_term_in_words(term, expected):
    assert words(term) == expected


@pytest.mark.parametrize("group", [ForceTerms, MomentTerms, DiscoveredForce, DiscoveredMoment])
def test_the_groups_hold_every_term_once_in_order(group):
    terms = [*TERMS, *(ENVIRONMENT_TERMS if group in (DiscoveredForce, DiscoveredMoment) else ())]
    assert list_paths(group()) == terms
    assert len(set(terms)) == len(terms)
    assert all(spec_at(group(), term).neutral == 0.0 for term in terms)


def test_every_product_of_two_velocities_is_among_the_terms_once():
    pairs = {frozenset((a, b)) for a in "uvwpqr" for b in "uvwpqr" if a != b}
    assert {frozenset(term) for term in TERMS if len(term) == 2 and term[0] != term[1]} == pairs
    assert {term for term in TERMS if "_" in term} == {f"{a}_{a}" for a in "uvwpqr"}
    # u u is left out: a body that moves ahead or astern has drag either way, u |u|
    assert {term for term in TERMS if len(term) == 2 and term[0] == term[1]} == {f"{a}{a}" for a in "vwpqr"}
