"""Turning circles, zigzags and depth changes: `python -m scripts.studies.manoeuvres`."""
