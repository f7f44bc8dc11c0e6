"""The study of slips: one clean log of a glider with each slip in turn."""

from identification.diagnosis.log.slips import possible_slips
from scripts.studies import slips
from scripts.studies.harness import Found
from scripts.studies.slips import STUDY, right


def test_a_slip_is_right_if_named_and_a_clean_log_if_not_doubted():
    assert right({"slip": "", "doubts": []})
    assert not right({"slip": "", "doubts": ["mirrored"]})
    assert right({"slip": "mirrored", "doubts": ["other", "mirrored"]})
    assert not right({"slip": "mirrored", "doubts": []})


def test_slips_in_a_glider_s_log_are_noticed_and_counted(monkeypatch):
    few = {"the rudder acts with the opposite sign", "time runs at half"}

    def chosen(record, plant):
        return [slip for slip in possible_slips(record, plant) if any(slip.text.startswith(text) for text in few)]

    monkeypatch.setattr(slips, "possible_slips", chosen)
    found = STUDY.find([1], ["slocum"])
    clean, *made = found.of("slocum")[0]
    assert clean == {"slip": "", "doubts": []}
    assert len(made) == 2
    assert all(one["doubts"][0] == one["slip"] for one in made)
    (row,) = STUDY.sheets(found)[0].rows
    assert row == ["slocum", "1", "0", "2 of 2", ""]
    unnoticed = [{**one, "doubts": []} for one in made]
    (row,) = STUDY.sheets(Found({"slocum": {1: [clean, *unnoticed]}}, {}))[0].rows
    assert row[3:] == ["0 of 2", "; ".join(one["slip"] for one in made)]
