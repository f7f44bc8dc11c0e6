# %% [markdown]
# # An environment loop
#
# A REMUS 100 holds and changes its depth with the stern plane. Three controllers are driven through the same episode:
# none at all, two lines of proportional control, and the PID that comes with the vehicle. Then the vehicle is made
# 2 N lighter than its controllers assume.

# %%
import gymnasium
import matplotlib.pyplot as plt
import numpy as np

from controllers import autopilot

env = gymnasium.make("auv_gym/Depth-v0", vehicle="remus100")
inner = env.unwrapped
print("action: ", inner.episodes.actions)
print("observation: ", inner.episodes.observations)

# %% [markdown]
# ## One episode
#
# `choose` maps observation and info to an action. The start and the first target are given, so that all controllers
# see the same; the seed draws the rest.


# %%
def episode(env, choose):
    observation, info = env.reset(seed=3, options={"start": {"depth_m": 15.0}, "target": 18.0})
    total, times, depths, targets, ended = 0.0, [], [], [], False
    while not ended:
        times.append(info["time_s"])
        depths.append(info["state"]["depth_m"])
        targets.append(info["target"]["depth_m"])
        observation, reward, terminated, truncated, info = env.step(choose(observation, info))
        total += reward
        ended = terminated or truncated
    return total, np.array(times), np.array(depths), np.array(targets)


# %% [markdown]
# ## Controllers

# %%
CRUISE = env.reset(seed=3)[0][5]  # the plane that holds the vehicle level, over its stop
print(f"plane in cruise: {CRUISE:.2f} of its stop")


def idle(observation, info):
    return [CRUISE]


def proportional(observation, info):
    """Pitch down if the vehicle is too shallow; the plane, relative to cruise, acts against pitch and its rate."""
    error, pitch, pitch_rate = observation[:3]
    wanted = np.clip(-2.0 * error, -0.2, 0.2)
    return [np.clip(CRUISE + 3.0 * (pitch - wanted) + 2.0 * pitch_rate, -1.0, 1.0)]


class Autopilot:
    """The vehicle's own PID as a function of observation and info; it reads channels by name, in SI."""

    def __init__(self, env):
        self.inner = env.unwrapped
        self.pid = autopilot(self.inner.plant, targets=("depth_m",))
        self.memory = self.pid.start()

    def __call__(self, observation, info):
        reading = {**info["reading"], "dt_s": self.inner.plant.dt}
        command, self.memory = self.pid.act(self.memory, reading, info["target"])
        return self.inner.action_for(command)


# %% [markdown]
# ## Side by side

# %%
lighter = gymnasium.make("auv_gym/Depth-v0", vehicle="remus100", effects={"effects.load.net_buoyancy": 2.0})
print("controller     as designed   2 N too light")
runs = {}
for name, choose in {"idle": idle, "proportional": proportional, "PID": Autopilot}.items():
    made = [choose(e) if choose is Autopilot else choose for e in (env, lighter)]
    runs[name] = [episode(e, controller) for e, controller in zip((env, lighter), made)]
    print(f"{name:14}{runs[name][0][0]:12.1f}{runs[name][1][0]:16.1f}")

# %% [markdown]
# The rewards are sums over 600 steps of 0.1 s; a perfect controller comes near 0.

# %%
figure, panels = plt.subplots(1, 2, figsize=(9, 3.2), sharey=True, layout="constrained")
for panel, column, title in zip(panels, (0, 1), ("as designed", "2 N too light")):
    panel.step(runs["PID"][column][1], runs["PID"][column][3], "k:", where="post", label="target")
    for name, made in runs.items():
        panel.plot(made[column][1], made[column][2], label=name)
    panel.set(title=title, xlabel="time, s")
panels[0].set_ylabel("depth, m")
panels[0].invert_yaxis()
panels[0].legend()
figure.savefig("environment_loop.png", dpi=110)
