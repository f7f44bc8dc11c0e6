"""Gliders that tests share."""

from dataclasses import replace

from auv_gym.param import replace_at
from auv_gym.plant import load_vehicle

# A Slocum that answers its rudder within 12 s and whose coefficients are known to 10 %, so that tests about effects
# are not tests about what the preset does not know.
QUICK = replace(replace_at(load_vehicle("slocum"), {"hull.n_r": -0.0018, "hull.n_delta": 0.00065}), deviations={})
