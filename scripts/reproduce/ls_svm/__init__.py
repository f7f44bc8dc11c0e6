"""Xu et al. 2013: `python -m scripts.reproduce.ls_svm`."""
