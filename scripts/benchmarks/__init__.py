"""Benchmarks, which `scripts.benchmark` runs, and the systems and packages that they compare."""
