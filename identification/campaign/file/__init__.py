"""The campaign file: its settings, error messages for wrong settings, and the planned runs."""
