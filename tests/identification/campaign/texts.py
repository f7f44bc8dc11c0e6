"""Parts of campaign files that fail: a float below its depth limit, and a fit with more lags than samples."""

DEEP = """
name = "deep"
[vehicle]
preset = "qiandao_float"
[experiment]
kind = "env"
id = "FloatDepth"
duration_s = 900.0
depths = [1.0, 20.0]
start = { depth_m = 39.0 }
targets = { depth_m = [[0, 200.0]] }
[controller]
kind = "pid"
"""
HOPELESS = """
[[fit]]
name = "hopeless"
method = "arx"
settings = { n_a = 400 }
inputs = ["rudder_rad"]
outputs = ["heading_rad"]
"""
