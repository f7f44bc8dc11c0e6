"""Programs over the three packages: published results reproduced, and benchmarks.

Each module has `main(argv)`; run one with `python -m scripts.NAME`.
"""
