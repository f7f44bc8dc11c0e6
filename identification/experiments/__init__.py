"""Experiments that make a vehicle show itself: excitation, driven episodes, missions of each kind of vehicle."""
