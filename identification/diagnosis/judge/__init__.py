"""The judging step of a diagnosis: its result, how well the result explains the record, and the words for it."""
