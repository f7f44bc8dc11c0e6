"""What a diagnosis found, how well it explains the record, and the words for it."""
