from .for_casadi import CasadiModel as CasadiModel, casadi_model as casadi_model
