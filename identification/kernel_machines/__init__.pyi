from .fixed_size import FixedSize as FixedSize
from .hull.hull import HullLsSvm as HullLsSvm
from .ls_svm import LsSvm as LsSvm
from .machine import KernelMachine as KernelMachine
from .narx.narx import NarxLsSvm as NarxLsSvm
from .regression import LsSvmRegression as LsSvmRegression
