from .model import Diverged as Diverged, Model as Model, predict as predict, simulate as simulate
from .models.files import load_model as load_model, model_header as model_header, save_model as save_model
from .models.linear import Polynomial as Polynomial, StateSpace as StateSpace, linearise as linearise
from .models.narx import Narx as Narx
from .models.spliced import splice as splice
from .param import list_paths as list_paths, replace_at as replace_at, spec_at as spec_at, value_at as value_at
from .plant import (
    Plant as Plant,
    list_vehicles as list_vehicles,
    load_vehicle as load_vehicle,
    save_vehicle as save_vehicle,
    without_effects as without_effects,
)
from .records.reading import find_log as find_log, read_record as read_record
from .records.record import Record as Record, concat as concat

__version__: str
