"""The runs of a campaign, performed here or by workers."""
