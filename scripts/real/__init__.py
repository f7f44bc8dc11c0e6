"""Measured logs, for `python -m scripts.real_logs`: what they are, how each kind is judged, and the page about them."""
