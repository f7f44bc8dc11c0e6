from .comparison import (
    ClosedLoop as ClosedLoop,
    OpenLoop as OpenLoop,
    compare_closed as compare_closed,
    compare_open as compare_open,
    horizon_sweep as horizon_sweep,
)
from .model_tests import open_loop as open_loop, residual_tests as residual_tests, sweep_horizons as sweep_horizons
