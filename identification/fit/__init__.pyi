from .greybox import GreyBox as GreyBox
from .innovations import InnovationsForm as InnovationsForm
from .validation import (
    FreeRuns as FreeRuns,
    Score as Score,
    compare as compare,
    fitted_runs as fitted_runs,
    free_runs as free_runs,
    whiteness as whiteness,
)
from .windows import free_run_windows as free_run_windows, held_out as held_out
