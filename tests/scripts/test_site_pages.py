"""The pages that are made from the code name what there is."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from auv_gym.param import list_paths
from auv_gym.vehicles import effects_by_kind
from auv_gym.vehicles.body.kinds import part_kinds
from scripts.site_pages import effects_page, parts_page, write

ROOT = Path(__file__).parents[2]


def test_every_kind_of_part_has_a_section_with_its_forms_and_effects():
    page = parts_page()
    sections = {text.split("\n")[0]: text for text in page.split("\n## ")[1:]}
    assert list(sections) == list(part_kinds())
    for name, kind in part_kinds().items():
        for choice, form in (kind.variants or {"": kind}).items():
            assert f'`{kind.choice} = "{choice}"`' in sections[name] or not choice
            for path in list_paths(form.effects()):
                assert f"`effects.NAME.{path}`" in sections[name]


def test_a_long_table_of_numbers_is_its_first_and_its_last():
    curve = [row for row in parts_page().splitlines() if ".curve." in row]
    assert [row.split("`")[1] for row in curve] == ["parts.NAME.curve.m100", "parts.NAME.curve.p100"]


def test_every_effect_of_every_family_is_listed():
    page = effects_page()
    for effects in effects_by_kind().values():
        for path in list_paths(effects):
            assert path.startswith("discovered.") or f"| `effects.{path}` |" in page


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """The documentation's sources, as the builder gets them."""
    folder = tmp_path_factory.mktemp("site") / "docs"
    write(folder)
    return folder


def test_the_navigation_has_every_page_and_no_other(folder):
    """The builder reports broken links and anchors, but neither a page that nothing leads to nor a missing picture."""
    yaml = pytest.importorskip("yaml", reason="the extra `rl` is not installed")
    listed = list(pages_of(yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]))
    assert sorted(listed) == sorted(str(path.relative_to(folder)) for path in folder.rglob("*.md"))


def pages_of(entry) -> Iterator[str]:
    if isinstance(entry, str):
        yield entry
    else:
        for inner in entry.values() if isinstance(entry, dict) else entry:
            yield from pages_of(inner)


def test_every_picture_of_a_page_is_there(folder):
    shown = {
        (page, picture)
        for page in folder.rglob("*.md")
        for picture in re.findall(r"!\[[^\]]*\]\(([^)]+)\)", page.read_text(encoding="utf-8"))
    }
    assert len(shown) > 10
    assert [f"{page.name}: {picture}" for page, picture in shown if not (page.parent / picture).is_file()] == []


def test_a_folder_is_written_anew(tmp_path):
    (tmp_path / "old.md").write_text("a page that was")
    write(tmp_path)
    assert not (tmp_path / "old.md").exists()
    assert "(../" not in (tmp_path / "contributing.md").read_text()
    assert (tmp_path / "reference" / "commands.md").read_text().startswith("# Commands")
