"""Published results reproduced, one module a paper: `python -m scripts.reproduce.NAME`."""
