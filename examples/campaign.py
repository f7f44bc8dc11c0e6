# %% [markdown]
# # A model from experiments, in the vehicle's place
#
# A glider under its heading PID is excited at the rudder. Three models are fitted to that run, judged on another one,
# and driven by the same PID in the place of the vehicle.

# %%
import gymnasium
import numpy as np

from auv_gym import load_vehicle
from controllers import autopilot
from identification import closed_loop, compare_closed, compare_open, horizon_sweep, make_estimator, summary
from identification.pages.model_figures import rollout_figure

glider = load_vehicle("slocum")
train, unseen = (closed_loop(glider, rng=np.random.default_rng(seed), duration=900.0) for seed in (0, 1))

# %% [markdown]
# ## Fit
#
# The methods by name, as `auv-gym list methods` shows them. The grey box frees coefficients of the vehicle's own
# equations; the others know nothing of them.

# %%
channels = {"inputs": ["rudder_rad"], "outputs": ["heading_rad"]}
fits = {
    "arx": make_estimator("arx", {"n_a": 2, "n_b": 2}, **channels).fit(train),
    "armax": make_estimator("armax", {"n_a": 2, "n_b": 2, "n_c": 2}, **channels).fit(train),
    "grey_box": make_estimator("grey_box", plant=glider).fit(train),
}
for fit in fits.values():
    print(summary(fit), end="\n\n")
models = {name: fit.model for name, fit in fits.items()}

# %% [markdown]
# ## Judge on data that took no part

# %%
scores = compare_open(models, unseen).scores
ahead = [1, 10, 100]  # samples
print("          free runs,  predictions, rms, deg")
print("          fit     ", *(f"{unseen.sample_interval * k:6.0f} s" for k in ahead))
for name, model in models.items():
    errors = horizon_sweep(model, unseen, ahead)["heading_rad"]
    shown = (f"{np.rad2deg(errors[k]):8.2f}" for k in ahead)
    print(f"{name:9}{scores[name]['heading_rad'].fit_percent:6.1f} %  ", *shown)


# %% [markdown]
# ## In the vehicle's place
#
# `model=` puts a model where the vehicle was; a model that lacks some of the vehicle's outputs is spliced into it.


# %%
def make_env(model):
    return gymnasium.make("auv_gym/GliderHeading-v0", vehicle=glider, model=model, duration=300.0)


steps = {"heading_rad": [(0.0, 0.0), (100.0, 0.8), (200.0, 0.2)]}
closed = compare_closed(make_env, autopilot(glider), models, seed=0, targets=steps, start={"heading_rad": 0.0})
for name, deviations in closed.deviations.items():
    print(f"{name:9}{deviations['heading_rad'].percent:6.2f} % of the largest step")

# %%
runs = {name: run.record for name, run in closed.runs.items()}
figure = rollout_figure(closed.vehicle.record, runs, ["heading_rad"], "the vehicle")
figure.savefig("campaign.png", dpi=110)
