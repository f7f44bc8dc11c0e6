"""The parts of the blind benchmark: cases drawn from a seed, logs, simulators of their own, scores, tables."""
