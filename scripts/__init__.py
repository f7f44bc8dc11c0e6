"""Programs over the three packages: benchmarks, published results reproduced, studies, and what maintainers run.

Run one with `python -m scripts.NAME`, or `python -m scripts.FOLDER.NAME`.
"""
