# %% [markdown]
# # My log does not match my model
#
# A log is simulated with an effect that the model does not have. The diagnosis is given the log and the model, and
# nothing else.

# %%
import gymnasium
import numpy as np

from auv_gym import load_vehicle, replace_at
from identification import closed_loop, diagnose, write_diagnosis
from identification.pages.diagnosis_figures import zoom_figure

plant = load_vehicle("slocum")
truth = replace_at(plant, "effects.rudder.deadband", 0.06)  # rad; from here on nobody knows of it
log = closed_loop(truth, rng=np.random.default_rng(4), duration=1200.0)

# %% [markdown]
# ## Diagnosis

# %%
diagnosis = diagnose(log, plant)
print(diagnosis.summary())

# %%
for effect in diagnosis.effects:
    low, high = effect.ci95
    print(f"{effect.path}: {effect.value:.4f} {effect.unit}, 95 % interval {low:.4f} to {high:.4f}, truth 0.0600")

# %% [markdown]
# What this log could have shown, had it been there: the smallest size of other effects.

# %%
for other in diagnosis.detectable[:8]:
    print(f"{other.title:45}{other.size:8.3g} {other.unit}")

# %%
zoom_figure(diagnosis).savefig("log_and_model.png", dpi=110)

# %% [markdown]
# ## The better vehicle
#
# `write_diagnosis` leaves the report, the numbers, and the vehicle with the effect in it, ready for an environment.

# %%
write_diagnosis(diagnosis, "result")
env = gymnasium.make("auv_gym/GliderHeading-v0", vehicle="result/vehicle.toml")
observation, info = env.reset(seed=0)
print(f"deadband in the environment: {env.unwrapped.plant.effects.rudder.deadband:.4f} rad")
