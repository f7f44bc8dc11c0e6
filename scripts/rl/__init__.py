"""Parts of the study of policies trained on models; `scripts.rl_study` runs it."""
