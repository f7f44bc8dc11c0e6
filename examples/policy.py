# %% [markdown]
# # A policy learned on an identified model
#
# A glider turns by itself, as if a moment of 0.02 N m pushed it, and nobody knows. A policy is learned on the model as
# designed, another one on what a fit makes of the glider's log; both then steer the real one. One training each, in
# two minutes: `docs/rl_study.md` has the long answer. Needs the extra `rl`.

# %%
import matplotlib.pyplot as plt
import numpy as np

from auv_gym import load_vehicle, replace_at
from auv_gym.rl import Training, evaluate, fresh_seeds, train
from controllers import pilot_for
from identification import GreyBox, closed_loop

MOMENT = "effects.yaw.moment"
designed = load_vehicle("slocum")
glider = replace_at(designed, MOMENT, 0.02)

# %% [markdown]
# ## A log, and a fit to it

# %%
log = closed_loop(glider, rng=np.random.default_rng(0), duration=1200.0)
fit = GreyBox(designed, free=["hull.n_r", "hull.n_delta", MOMENT]).fit(log)
print(f"yaw moment: {fit[MOMENT].value:.4f} N m")

# %% [markdown]
# ## Learning on each
#
# A call that was stopped goes on where it was; one that is done is read from its folder.

# %%
models = {"designed": designed, "fitted": fit.model, "the glider itself": glider}
policies = {
    name: train(Training("GliderHeading-v0", on=model, steps=80_000), f"policies/{name.replace(' ', '_')}").policy
    for name, model in models.items()
}

# %% [markdown]
# ## On the glider, episodes that no training has seen

# %%
seeds = fresh_seeds(0, 20)
env = policies["fitted"].env(glider)
agents = {**policies, "PID": pilot_for(env, "pid")}
found = {name: evaluate(agent, env, seeds).summary for name, agent in agents.items()}
for name, summary in found.items():
    low, high = summary.mean_interval
    print(f"{name:20}{summary.mean:8.2f}   95 % interval {low:.2f} to {high:.2f}")

# %%
figure, panel = plt.subplots(figsize=(6, 2.6), layout="constrained")
for row, summary in enumerate(found.values()):
    panel.plot(summary.mean_interval, [row, row], "k-")
    panel.plot(summary.mean, row, "o")
panel.set(yticks=range(len(found)), yticklabels=list(found), xlabel="mean return on the glider, 20 episodes of 600 s")
panel.invert_yaxis()
figure.savefig("policy.png", dpi=110)
