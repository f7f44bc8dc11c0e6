"""The pages that are made from the code name what there is."""

from auv_gym.param import list_paths
from auv_gym.vehicles import effects_by_kind
from auv_gym.vehicles.body.kinds import part_kinds
from scripts.site_pages import effects_page, parts_page


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
