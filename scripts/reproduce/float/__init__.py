"""Zhong et al. 2024 on a simulated float: `python -m scripts.reproduce.float`."""
