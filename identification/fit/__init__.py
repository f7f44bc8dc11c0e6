"""Grey-box fits of a plant, and their parts: windows, free runs, the likelihood and process noise."""
