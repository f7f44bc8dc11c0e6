from .compare import compare_closed as compare_closed, compare_open as compare_open, horizon_sweep as horizon_sweep
from .diagnosis import Diagnosis as Diagnosis, diagnose as diagnose, write_diagnosis as write_diagnosis
from .estimate import Estimate as Estimate
from .estimator import (
    Method as Method,
    list_methods as list_methods,
    make_estimator as make_estimator,
    summary as summary,
)
from .experiments import (
    chirp as chirp,
    closed_loop as closed_loop,
    depth_control as depth_control,
    doublet as doublet,
    drive as drive,
    oil_mission as oil_mission,
    prbs as prbs,
    run_mission as run_mission,
    steer as steer,
)
from .fit import GreyBox as GreyBox
from .identified import Identified as Identified, identify as identify
from .kernel_machines import (
    FixedSize as FixedSize,
    HullLsSvm as HullLsSvm,
    LsSvm as LsSvm,
    LsSvmRegression as LsSvmRegression,
    NarxLsSvm as NarxLsSvm,
)
from .linear import (
    Armax as Armax,
    Arx as Arx,
    Els as Els,
    N4sid as N4sid,
    OutputError as OutputError,
    Pbsid as Pbsid,
    search_orders as search_orders,
)
from .recursive import (
    CorrectedIvls as CorrectedIvls,
    DivingModel as DivingModel,
    Ivls as Ivls,
    RefinedIv as RefinedIv,
    Rwls as Rwls,
)
