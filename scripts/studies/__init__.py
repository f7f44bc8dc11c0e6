"""Completed studies, with results quoted in the documentation: `python -m scripts.studies.NAME`."""
