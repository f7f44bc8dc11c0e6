"""The study of tuned gains: the rows of its table."""

from scripts.studies.gains import SHOWN, STUDY
from scripts.studies.harness import Found


def test_rows_have_median_and_worst_of_all_vehicles_of_all_seeds():
    runs = {
        seed: {"refused": 0, "loops": {"depth_m": dict.fromkeys(SHOWN, values)}}
        for seed, values in ((100, [1.0, 2.0]), (101, [1.5, 4.0, 1.25]))
    }
    (sheet,) = STUDY.sheets(Found({"npsauv, tuned": runs}, {}))
    assert sheet.rows == [["npsauv", "depth_m", "tuned", "5", "4", "1.5 (4)", "1.5 (4)", "1.5 (4)"]]
