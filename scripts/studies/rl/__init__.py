"""The study of policies trained on models: `python -m scripts.studies.rl`."""
