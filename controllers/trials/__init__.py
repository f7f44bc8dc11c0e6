"""Controllers tried out in closed loop on a plant, and how well they followed."""
