"""The next experiment: which one tells apart what this record could not."""
