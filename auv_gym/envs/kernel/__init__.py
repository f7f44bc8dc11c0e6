"""The compiled step of an environment: its numbers, its programs, and the hooks for each kind of vehicle."""
