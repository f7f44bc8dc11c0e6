"""What has changed between missions, and when it began."""
