from .compare.closed_loop import compare_closed as compare_closed
from .compare.comparison import compare_open as compare_open, horizon_sweep as horizon_sweep
from .diagnosis import Diagnosis as Diagnosis, diagnose as diagnose, write_diagnosis as write_diagnosis
from .estimate import Estimate as Estimate
from .estimator import (
    Method as Method,
    list_methods as list_methods,
    make_estimator as make_estimator,
    summary as summary,
)
from .experiments.driving import drive as drive
from .experiments.excitation import chirp as chirp, doublet as doublet, make_signal as make_signal, prbs as prbs
from .experiments.float_dives import depth_control as depth_control, oil_mission as oil_mission
from .experiments.heading_control import closed_loop as closed_loop
from .experiments.manoeuvres import steer as steer
from .experiments.missions import run_mission as run_mission
from .fit.greybox import GreyBox as GreyBox
from .identified import Identified as Identified, identify as identify
from .kernel_machines.fixed_size import FixedSize as FixedSize
from .kernel_machines.hull.hull import HullLsSvm as HullLsSvm
from .kernel_machines.ls_svm import LsSvm as LsSvm
from .kernel_machines.narx.narx import NarxLsSvm as NarxLsSvm
from .kernel_machines.regression import LsSvmRegression as LsSvmRegression
from .linear.poles import pole_intervals as pole_intervals
from .linear.polynomials.armax import Armax as Armax
from .linear.polynomials.arx import Arx as Arx
from .linear.polynomials.els import Els as Els
from .linear.polynomials.orders import search_orders as search_orders
from .linear.polynomials.output_error import OutputError as OutputError
from .linear.subspaces.n4sid import N4sid as N4sid
from .linear.subspaces.pbsid import Pbsid as Pbsid
from .linear.uncertainty import response_band as response_band, simulated_band as simulated_band
from .monitor.monitor import Alarm as Alarm, Monitor as Monitor
from .monitor.wrapper import Monitored as Monitored
from .recursive.corrected_ivls import CorrectedIvls as CorrectedIvls
from .recursive.diving_model import DivingModel as DivingModel
from .recursive.ivls import Ivls as Ivls
from .recursive.refined_iv import RefinedIv as RefinedIv
from .recursive.rwls import Rwls as Rwls
