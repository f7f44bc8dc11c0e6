"""Planning the next experiment: which one tells apart the causes that a record could not."""
