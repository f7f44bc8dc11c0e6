"""Presets with programs of their own, of which others have the like, so that most tests are not repeated for them."""

UNCOMPILED = ("bluerov", "bluerov2")  # by slow tests only
SIMULATED = ("npsauv", "seawing")  # by many tests; filtered, and in an environment, by slow ones only
SELDOM = {*UNCOMPILED, *SIMULATED}
