"""Diagnosis: which physical effect a vehicle's model is missing, from a log that disagrees with it."""

from identification.diagnosis.diagnose import diagnose
from identification.diagnosis.judge.verdict import Diagnosis
from identification.diagnosis.result_files import again, as_json, write_diagnosis

__all__ = ["Diagnosis", "again", "as_json", "diagnose", "write_diagnosis"]
