# %% [markdown]
# # Model predictive control with CasADi
#
# `casadi_model` gives the vehicle's right-hand side as a CasADi function. Here IPOPT plans with it, four seconds ahead,
# and the simulator takes the first command of each plan: a REMUS 100 dives by 1 m while it turns by 45 deg.

# %%
import casadi as ca
import matplotlib.pyplot as plt
import numpy as np

from auv_gym import load_vehicle
from auv_gym.exports import casadi_model
from auv_gym.param import replace_at
from auv_gym.plant.cruise import find_cruise

DT, AHEAD, SAMPLES = 0.25, 16, 36
plant = load_vehicle("remus100")
# fins that are limited in rate have a kink that IPOPT would stumble over: the plan has the limit as a constraint
model = casadi_model(replace_at(plant, {"parts.rudder.slowness": 0.0, "parts.stern_plane.slowness": 0.0}))
heading, depth, pitch = (model.states.index(name) for name in ("heading_rad", "depth_m", "pitch_rad"))
print(f"{len(model.states)} states, {len(model.inputs)} inputs: {', '.join(model.inputs)}")


# %% [markdown]
# ## The plan
#
# One step of Runge-Kutta between samples; fins within their stops and rates; errors, pitch and moves of the fins cost.
# The shaft speed stays as it is.


# %%
def step(x, u):
    """The state a sample later."""
    k1 = model.rhs(x, u)
    k2 = model.rhs(x + DT / 2 * k1, u)
    k3 = model.rhs(x + DT / 2 * k2, u)
    return x + DT / 6 * (k1 + 2 * k2 + 2 * k3 + model.rhs(x + DT * k3, u))


cruise = find_cruise(plant)
limits = 0.99 * plant.parts.rudder.limit, 0.99 * plant.parts.stern_plane.limit  # at the stop itself is a kink, too
fastest = DT / plant.parts.rudder.slowness
target = np.array([np.deg2rad(45.0), 1.0])

opti = ca.Opti()
x, fins = opti.variable(len(model.states), AHEAD + 1), opti.variable(2, AHEAD)
start, before = opti.parameter(len(model.states)), opti.parameter(2)
opti.subject_to(x[:, 0] == start)
cost = 0
for k in range(AHEAD):
    opti.subject_to(x[:, k + 1] == step(x[:, k], ca.vertcat(fins[:, k], cruise.commands[2])))
    error = x[[heading, depth], k + 1] - target
    move = fins[:, k] - (fins[:, k - 1] if k else before)
    opti.subject_to(opti.bounded(-fastest, move, fastest))
    cost += error[0] ** 2 + 0.5 * error[1] ** 2 + x[pitch, k + 1] ** 2 + 0.5 * ca.sumsqr(move)
for row, limit in enumerate(limits):
    opti.subject_to(opti.bounded(-limit, fins[row, :], limit))
opti.minimize(cost)
opti.solver(
    "ipopt", {"print_time": False, "expand": True}, {"print_level": 0, "sb": "yes", "max_iter": 25, "tol": 1e-4}
)

# %% [markdown]
# ## The loop
#
# The simulator starts at its cruise, and each plan starts from where the last one was.

# %%
full = plant.settled(cruise.state, cruise.commands)
seen = [plant.states.index(name) for name in model.states]
opti.set_initial(x, np.tile(full[seen][:, None], AHEAD + 1))
track, commands, first = [], [], cruise.commands[:2]
for _ in range(SAMPLES):
    opti.set_value(start, full[seen])
    opti.set_value(before, first)
    plan = opti.solve_limited()  # what IPOPT has after 25 iterations will do
    opti.set_initial(plan.value_variables())
    first = np.array(plan.value(fins[:, 0]))
    track.append(full[seen])
    commands.append(first)
    full = plant.step_over(full, np.array([*first, cruise.commands[2]]), DT)
track, commands = np.array(track), np.array(commands)
error_heading, error_depth = np.rad2deg(track[-1, heading] - target[0]), track[-1, depth] - target[1]
print(f"after {SAMPLES * DT:g} s the heading is off by {error_heading:.2f} deg and the depth by {error_depth:.2f} m")

# %%
time = DT * np.arange(SAMPLES)
figure, axes = plt.subplots(3, 1, sharex=True, figsize=(7, 6), layout="constrained")
axes[0].plot(time, np.rad2deg(track[:, heading]))
axes[0].axhline(np.rad2deg(target[0]), color="0.6", linestyle="--")
axes[0].set_ylabel("heading, deg")
axes[1].plot(time, track[:, depth])
axes[1].axhline(target[1], color="0.6", linestyle="--")
axes[1].invert_yaxis()
axes[1].set_ylabel("depth, m")
axes[2].step(time, np.rad2deg(commands), where="post", label=["rudder", "stern plane"])
axes[2].set(ylabel="commands, deg", xlabel="time, s")
axes[2].legend()
figure.savefig("predictive_control.png", dpi=120)
