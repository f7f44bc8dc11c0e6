"""The kinds of vehicle that environments know: one package each, with one `KIND` in it."""

from auv_gym.envs.kind import EnvKind
from auv_gym.kinds import Kinds

KINDS: Kinds[EnvKind] = Kinds("auv_gym.envs.kinds", "Environments know")
