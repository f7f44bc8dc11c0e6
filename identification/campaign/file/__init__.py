"""The campaign file: its settings, what is wrong with them in words, and the runs that it plans."""
