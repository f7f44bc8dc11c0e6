from .corrected_ivls import CorrectedIvls as CorrectedIvls
from .diving_model import DivingModel as DivingModel
from .ivls import Ivls as Ivls
from .refined_iv import RefinedIv as RefinedIv
from .rwls import Rwls as Rwls
