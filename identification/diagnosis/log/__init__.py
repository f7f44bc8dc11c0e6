"""The log itself: slips in how it was written down, and sensors that contradict each other."""
