"""The parts of the blind benchmark: cases drawn from a seed, logs, independent simulators, scores, tables."""
