"""Runners of the benchmarks of identification and of kernel regression.

Each fits the same arrays in a process of its own, and if needed in an environment of its own, and prints its results as
JSON.  See `scripts.benchmarks.peers.runner`.
"""
