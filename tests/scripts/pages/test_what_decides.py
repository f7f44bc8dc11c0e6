"""The constants that decide a diagnosis: each says where it comes from, and the page has them all."""

import re
from pathlib import Path

import pytest

from identification import deciding
from scripts.pages import what_decides
from scripts.pages.marked import with_marked
from scripts.pages.what_decides import PAGE, constants, with_table

ROOT = Path(__file__).parents[3]


def test_the_table_on_the_page_is_that_of_the_module():
    page = PAGE.read_text(encoding="utf-8")
    assert with_table(page) == page, "run: python -m scripts.pages.what_decides"


def test_each_constant_has_a_step_and_a_source():
    found = list(constants())
    names = sorted(name for name in vars(deciding) if name.isupper())
    assert sorted(c.name for c in found) == names  # none twice: the later one would count for both
    assert {c.step for c in found} == {"Shared", "Check", "Fit", "Search", "Judge"}
    assert all(c.decides and c.source for c in found)


@pytest.mark.parametrize("name", [name for name in vars(deciding) if name.isupper()])
def test_each_constant_is_used_and_no_other_module_has_one_of_that_name(name):
    sources = [
        p.read_text(encoding="utf-8") for p in (ROOT / "identification").rglob("*.py") if p.name != "deciding.py"
    ]
    assert any(re.search(rf"\b{name}\b", text) for text in sources)
    own = re.compile(rf"^{name}\b[^=\n]*=[^=]", re.MULTILINE)
    assert not [text.splitlines()[0] for text in sources if own.search(text) and "identification.deciding" in text]


def test_a_constant_without_a_source_and_a_page_without_marks_are_refused(tmp_path, monkeypatch):
    bare = tmp_path / "bare.py"
    bare.write_text('# Shared: x\nSURE = 3.0\n"""Standard errors."""\n')
    monkeypatch.setattr(what_decides.deciding, "__file__", str(bare))
    with pytest.raises(ValueError, match="ends with its source"):
        list(constants())
    with pytest.raises(ValueError, match="needs the marks"):
        with_marked("a page", "a table", "text")
