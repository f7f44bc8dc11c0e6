from .for_casadi import CasadiModel as CasadiModel, casadi_model as casadi_model
from .for_control import control_system as control_system
from .for_gazebo import GazeboWorld as GazeboWorld, gazebo_world as gazebo_world
from .for_minari import dataset_of_records as dataset_of_records, dataset_of_rollouts as dataset_of_rollouts
