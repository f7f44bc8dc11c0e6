"""Programs over the three packages: benchmarks, reproductions of published results, studies, and maintenance.

Run one with `python -m scripts.NAME`, or `python -m scripts.FOLDER.NAME`.
"""
