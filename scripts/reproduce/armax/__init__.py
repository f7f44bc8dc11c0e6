"""Geng and Zhao 2012: `python -m scripts.reproduce.armax`."""
