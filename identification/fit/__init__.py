"""The grey box and what every fit of a plant shares: windows, free runs, likelihood, process noise."""
