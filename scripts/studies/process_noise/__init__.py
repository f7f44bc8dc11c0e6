"""Fits and diagnoses of vehicles pushed by random accelerations: `python -m scripts.studies.process_noise`."""
