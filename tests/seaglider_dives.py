"""Small files of a Seaglider's dives, as the basestation writes them."""

from collections.abc import Mapping
from pathlib import Path

import h5py
import numpy as np


def write_dive(
    path: Path, vehicle: str, number: int, columns: Mapping[str, np.ndarray], constants: Mapping[str, float]
) -> Path:
    """Write a dive of samples by the basestation's own names, with the constants that its file states."""
    with h5py.File(path, "w") as file:
        file.attrs["dive_number"], file.attrs["platform_id"] = number, vehicle
        dim = file.create_dataset("sg_data_point", data=np.arange(len(columns["time"]), dtype=float))
        dim.make_scale("sg_data_point")
        for key, values in columns.items():
            file[key] = values
            file[key].dims[0].attach_scale(dim)
        file["time"].attrs["units"] = "seconds since 1970-1-1 00:00:00"
        file["depth"].attrs["units"] = "meters"
        for key, value in constants.items():
            file[key] = value
    return path
