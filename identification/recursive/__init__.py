"""Recursive identification of a float's diving model: sample by sample, or over whole records."""
