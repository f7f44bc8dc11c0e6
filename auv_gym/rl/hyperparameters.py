"""Hyperparameters of PPO, by environment: YAML in the form of RL Zoo, checked key by key."""

from __future__ import annotations

import os
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError

from auv_gym.extra import needs
from auv_gym.param import did_you_mean

_LINEAR = "lin_"

Count = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0.0)]
Share = Annotated[float, Field(ge=0.0, le=1.0)]


class _Table(BaseModel):
    # not strict: YAML reads 3e-4 as text, and 1e6 as a float
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


def _schedule(value: float | str) -> float | str:
    if isinstance(value, str) and value.startswith(_LINEAR):
        number = value.removeprefix(_LINEAR)
    else:
        number = value
    try:
        fine = float(number) > 0.0
    except ValueError:
        fine = False
    if not fine:
        raise ValueError(f"needs a number above 0, or one that falls to 0 such as lin_3e-4, got {value!r}")
    return value if number is not value else float(number)


Schedule = Annotated[float | str, AfterValidator(_schedule)]


class Normalize(_Table):
    """Division by a running standard deviation while training; a policy keeps that of the observations."""

    norm_obs: bool = True
    norm_reward: bool = True
    clip_obs: Positive = 10.0
    clip_reward: Positive = 10.0


class Networks(_Table):
    """The `policy_kwargs`: sizes of the hidden layers, their activation, and the size of the initial action noise.

    lstm_hidden_size: of the recurrent layer before them, by default 64.
    """

    net_arch: list[Count] | dict[Literal["pi", "vf"], list[Count]] | None = None
    activation_fn: Literal["tanh", "relu", "elu"] | None = None
    log_std_init: float | None = None
    ortho_init: bool | None = None
    lstm_hidden_size: Count | None = None


class Imitation(_Table):
    """A start from a controller: number of episodes that it drives, and passes over these data.

    noise: largest standard deviation of an episode's offsets to its actions.  hold: steps that an offset lasts.
    value_steps: steps of the training in which only values are learnt; with poor values, the imitated actions are soon
    forgotten.
    """

    controller: Literal["pid", "s_plane", "gpc"]
    episodes: Count = 64
    passes: Count = 20
    noise: float = Field(0.3, ge=0.0)
    hold: Count = 10
    value_steps: int = Field(0, ge=0)


class Hyperparameters(_Table):
    """Settings of proximal policy optimisation (Schulman et al. 2017), named as in stable-baselines3 and RL Zoo.

    env_kwargs: options of the environment.  train_env_kwargs: further ones for the training environments, such as
    shorter episodes; the policy is judged without these.  frame_stack: number of latest observations that the policy
    sees at once.
    action_scale: the unit of the agent's actions, one for all or one each, best about as large as usual actions: noise
    and learning rates are in these units.  policy: with MlpLstmPolicy the agent is RecurrentPPO of sb3-contrib.

    Example:

        >>> from auv_gym.rl import Hyperparameters
        >>> chosen = Hyperparameters(n_timesteps=50_000, gamma=0.98, policy="MlpLstmPolicy")
        >>> chosen.agent_settings, chosen.recurrent
        ({'gamma': 0.98}, True)
    """

    n_timesteps: Count
    n_envs: Count = 1
    env_kwargs: dict[str, Any] = {}
    train_env_kwargs: dict[str, Any] = {}
    frame_stack: Count = 1
    action_scale: Positive | list[Positive] = 1.0
    policy: Literal["MlpPolicy", "MlpLstmPolicy"] = "MlpPolicy"
    normalize: bool | Normalize = False
    policy_kwargs: Networks = Networks()
    imitate: Imitation | None = None
    learning_rate: Schedule = 3e-4
    clip_range: Schedule = 0.2
    gamma: Share = 0.99
    n_steps: Count = 2048
    batch_size: Count = 64
    n_epochs: Count = 10
    gae_lambda: Share = 0.95
    ent_coef: float = Field(0.0, ge=0.0)
    vf_coef: float = Field(0.5, ge=0.0)
    max_grad_norm: float = Field(0.5, gt=0.0)
    normalize_advantage: bool = True
    target_kl: float | None = Field(None, gt=0.0)
    use_sde: bool = False
    sde_sample_freq: int = Field(-1, ge=-1)

    @property
    def recurrent(self) -> bool:
        """Whether the policy has a recurrent layer."""
        return self.policy == "MlpLstmPolicy"

    @property
    def normalizer(self) -> Normalize | None:
        """The normalisation settings, None without normalisation."""
        if isinstance(self.normalize, Normalize):
            return self.normalize
        return Normalize() if self.normalize else None

    @property
    def agent_settings(self) -> dict[str, Any]:
        """The explicitly given arguments that PPO's constructor takes unchanged."""
        return self.model_dump(exclude_unset=True, exclude=_OTHERS)


_OTHERS = {
    "n_timesteps", "n_envs", "env_kwargs", "train_env_kwargs", "frame_stack", "action_scale", "policy", "normalize",
    "policy_kwargs", "imitate", "learning_rate", "clip_range",
}  # fmt: skip
_INNER: dict[str, type[_Table]] = {"policy_kwargs": Networks, "normalize": Normalize, "imitate": Imitation}
_SHIPPED = "ppo.yml"


def hyperparameters_for(env: str, file: str | os.PathLike | None = None) -> Hyperparameters:
    """The hyperparameters of an environment, from a file of the same form or from the shipped ones.

    env: `auv_gym/Depth-v0` or `Depth-v0`.  Raises on an unknown key or value by its name, and if there are none.

    Example:

        >>> from auv_gym.rl import hyperparameters_for
        >>> chosen = hyperparameters_for("Heading-v0")
        >>> chosen.n_envs, chosen.gamma, chosen.learning_rate
        (32, 0.98, 'lin_1e-3')
    """
    tables = _read(file)
    name = env.rpartition("/")[2]
    where = _SHIPPED if file is None else f"{file}"
    if name not in tables:
        raise ValueError(
            f"{where} has no hyperparameters for {name!r}. {did_you_mean(name, tables)}It has {', '.join(tables)}: "
            f"write a file with the key {name} and give it."
        )
    return checked(tables[name], f"{where}, {name}")


def checked(values: Any, where: str = "hyperparameters") -> Hyperparameters:
    """The hyperparameters from a mapping; raises with every wrong key."""
    if not isinstance(values, dict):
        raise ValueError(f"{where}: needs keys and values, got {values!r}.")
    try:
        made = Hyperparameters.model_validate(values)
    except ValidationError as error:
        raise ValueError(f"{where}: {'; '.join(map(_words, error.errors()))}.") from None
    if made.n_steps * made.n_envs < 2:
        raise ValueError(f"{where}: n_steps times n_envs needs to be 2 or more, got 1: raise n_steps.")
    if made.recurrent and made.imitate is not None:
        raise ValueError(f"{where}: a recurrent policy cannot begin from a controller: leave out imitate or policy.")
    if not made.recurrent and made.policy_kwargs.lstm_hidden_size is not None:
        raise ValueError(f"{where}: policy_kwargs.lstm_hidden_size needs policy MlpLstmPolicy: leave it out.")
    return made


def _read(file: str | os.PathLike | None) -> dict[str, Any]:
    with needs("Hyperparameters in YAML need pyyaml", "rl"):
        import yaml
    try:
        source = files("auv_gym.rl") / _SHIPPED if file is None else Path(file)
        tables = yaml.safe_load(source.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(f"Cannot read hyperparameters from {file}: {error}. Give a .yml file.") from None
    except yaml.YAMLError as error:
        raise ValueError(f"{file} is no YAML: {' '.join(str(error).split())}.") from None
    if not isinstance(tables, dict) or not all(isinstance(name, str) for name in tables):
        raise ValueError(f"{file} needs environments as keys, such as Depth-v0, with hyperparameters below each.")
    return tables


def _words(error: Any) -> str:
    path = ".".join(str(part) for part in error["loc"])
    if error["type"] == "extra_forbidden":
        name = str(error["loc"][-1])
        known = next((of for key, of in _INNER.items() if key in error["loc"]), Hyperparameters)
        return f"unknown key {path}. {did_you_mean(name, known.model_fields)}Keys: {', '.join(known.model_fields)}"
    if error["type"] == "missing":
        return f"{path} is needed"
    message = error["msg"].removeprefix("Value error, ")
    return f"{path}: {message[:1].lower()}{message[1:]}, got {error['input']!r}"
