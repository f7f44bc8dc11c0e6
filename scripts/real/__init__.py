"""Measured logs, for `python -m scripts.real_logs`: their description, how each kind is judged, and their page."""
