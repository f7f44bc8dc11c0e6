"""Reproductions of published results, one module for each paper: `python -m scripts.reproduce.NAME`."""
