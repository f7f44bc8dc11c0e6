"""Controllers of underwater vehicles: each turns a measurement and a target into a command, once per sample.

They read channels of `auv_gym` by name and know nothing of identification.
"""
