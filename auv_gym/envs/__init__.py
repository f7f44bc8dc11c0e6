"""Gymnasium environments; importing this package registers them."""

from auv_gym.envs.registration import register_envs

register_envs()
