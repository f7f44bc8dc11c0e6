"""A vehicle's hull learned from its logs."""
