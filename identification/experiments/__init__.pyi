from .driving import Run as Run, drive as drive
from .excitation import (
    bang_bang as bang_bang,
    chirp as chirp,
    doublet as doublet,
    make_signal as make_signal,
    prbs as prbs,
    set_point_steps as set_point_steps,
    slow_variation as slow_variation,
    steps as steps,
)
from .float_dives import (
    depth_control as depth_control,
    oil_mission as oil_mission,
    summer_lake as summer_lake,
    summer_sea as summer_sea,
)
from .heading_control import closed_loop as closed_loop
from .manoeuvres import steer as steer, steered as steered
from .missions import run_mission as run_mission
