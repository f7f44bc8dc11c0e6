"""Runners of the benchmarks of identification and of kernel regression: each fits the same arrays in a process, and
where needed an environment, of its own, and prints what it found as JSON.  See `scripts.benchmarks.peers.runner`.
"""
