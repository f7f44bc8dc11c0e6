"""Penalty and width of a kernel machine, chosen."""
