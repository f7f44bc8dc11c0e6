"""Parts of `scripts.reproduce_armax`: models, study, control, tables, pictures."""
