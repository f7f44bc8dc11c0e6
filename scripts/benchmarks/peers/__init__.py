"""Runners of the benchmark of identification: each fits the same arrays in a process, and where needed an environment,
of its own, and prints what it found as JSON.  See `scripts.benchmarks.peers.runner`.
"""
