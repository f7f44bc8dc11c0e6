from .model import Diverged as Diverged, Model as Model, predict as predict, simulate as simulate
from .models import (
    Narx as Narx,
    Polynomial as Polynomial,
    StateSpace as StateSpace,
    linearise as linearise,
    load_model as load_model,
    save_model as save_model,
    splice as splice,
)
from .param import list_paths as list_paths, replace_at as replace_at, spec_at as spec_at, value_at as value_at
from .plant import (
    Plant as Plant,
    list_vehicles as list_vehicles,
    load_vehicle as load_vehicle,
    save_vehicle as save_vehicle,
    without_effects as without_effects,
)
from .records import Record as Record, concat as concat, find_log as find_log, read_record as read_record

__version__: str
