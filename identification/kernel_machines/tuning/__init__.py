"""The choice of penalty and width of a kernel machine."""
