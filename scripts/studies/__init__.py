"""Finished studies, whose figures the documentation gives: `python -m scripts.studies.NAME`."""
