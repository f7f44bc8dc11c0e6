from .files import load_model as load_model, model_header as model_header, save_model as save_model
from .linear import Polynomial as Polynomial, StateSpace as StateSpace, linearise as linearise
from .narx import Narx as Narx
from .spliced import Spliced as Spliced, splice as splice
