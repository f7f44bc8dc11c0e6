"""The plant: a vehicle's parameters and effects, integrated in time, as a `Model`; and vehicle files."""

from auv_gym.plant.charts import Chart
from auv_gym.plant.plant import Plant, check_deviation, check_vehicle, without_effects
from auv_gym.plant.runs import Correction, Runs
from auv_gym.plant.vehicle_files import list_vehicles, load_vehicle, save_vehicle, vehicle_of_text, vehicle_text

__all__ = [
    "Chart",
    "Correction",
    "Plant",
    "Runs",
    "check_deviation",
    "check_vehicle",
    "list_vehicles",
    "load_vehicle",
    "save_vehicle",
    "vehicle_of_text",
    "vehicle_text",
    "without_effects",
]
