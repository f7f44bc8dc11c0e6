"""Fits and diagnoses of vehicles that something pushes about: `python -m scripts.studies.process_noise`."""
