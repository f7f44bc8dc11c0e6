"""Benchmarks, run by `scripts.benchmark`, and the systems and packages that they compare."""
