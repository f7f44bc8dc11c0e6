"""How the house is built: nothing asks for the name of a kind of vehicle, no circular import, few files at the top."""

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from auv_gym.vehicles import FAMILIES, compose
from auv_gym.vehicles.body.body import Part

ROOT = Path(__file__).parents[1]
PACKAGES = ("auv_gym", "controllers", "identification", "scripts")
MOST_FILES = 12  # at the top of a package
# names of kinds and families, those of former versions and of papers among them
COMPOSED = (compose(()), compose([Part("t1", "thruster", "share")]))
NAMES = {"torpedo", "heading", *(name for f in (*FAMILIES.values(), *COMPOSED) for name in (f.name, f.kind))}
_OF_A_VEHICLE = {"kind", "family", "family_name"}


@cache
def trees() -> dict[str, ast.Module]:
    """The modules of all packages by dotted name."""
    found = {}
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
            found[name] = ast.parse(path.read_text(encoding="utf-8"))
    return found


def strings_in(node: ast.expr) -> set[str]:
    return {n.value for n in ast.walk(node) if isinstance(n, ast.Constant) and isinstance(n.value, str)}


def is_of_a_vehicle(node: ast.expr) -> bool:
    """Whether an expression is the name of a kind or family, such as `plant.family.kind`, `family.name` or `kind`."""
    if isinstance(node, ast.Attribute):
        inner = node.value.attr if isinstance(node.value, ast.Attribute) else getattr(node.value, "id", "")
        return node.attr in _OF_A_VEHICLE or (node.attr == "name" and inner == "family")
    return isinstance(node, ast.Name) and node.id in _OF_A_VEHICLE


def comparisons(tree: ast.Module) -> Iterator[int]:
    """Lines that compare with the name of a kind or family, or match one."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            asked = [is_of_a_vehicle(side) for side in sides]
            if any(asked) and NAMES & set().union(*(strings_in(s) for s, is_it in zip(sides, asked) if not is_it)):
                yield node.lineno
        elif (
            isinstance(node, ast.Match)
            and is_of_a_vehicle(node.subject)
            and NAMES & set().union(*(strings_in(n.value) for n in ast.walk(node) if isinstance(n, ast.MatchValue)))
        ):
            yield node.lineno


def tables(tree: ast.Module) -> Iterator[int]:
    """Lines of dictionaries whose keys are names of kinds or families."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            keys = {k.value for k in node.keys if isinstance(k, ast.Constant) and isinstance(k.value, str)}
            if len(keys & NAMES) > 1:
                yield node.lineno


def imports(name: str, tree: ast.Module) -> set[str]:
    """The modules that a module imports, those for types or inside of functions included."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= inner & set(trees()) or {node.module}
    return (found & set(trees())) - {name}


def found_in(check, code: str) -> list[int]:
    return list(check(ast.parse(code)))


@pytest.mark.parametrize("check", [comparisons, tables])
def test_no_code_asks_which_kind_of_vehicle_it_has(check):
    assert [f"{name}:{line}" for name, tree in trees().items() for line in check(tree)] == []


def test_no_import_is_circular():
    circle: list[str] = []
    try:
        tuple(TopologicalSorter({name: imports(name, tree) for name, tree in trees().items()}).static_order())
    except CycleError as error:
        circle = error.args[1]
    assert circle == []


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_has_few_files_at_its_top(package):
    files = sorted(path.name for path in (ROOT / package).glob("*.py"))
    assert len(files) <= MOST_FILES, f"{package} has {', '.join(files)}: put what belongs together into a folder."


def test_the_checks_see_what_they_are_for():
    for code in ('plant.family.kind == "float"', 'x = 1 if kind in ("body", "crab") else 2', '"glider" != family.name'):
        assert found_in(comparisons, code) == [1]
    assert found_in(comparisons, 'match family.kind:\n    case "body":\n        pass') == [1]
    for code in ('kind == "open"', "record.kind == plant.kind", 'name == "float"'):
        assert found_in(comparisons, code) == []
    assert found_in(tables, 'a = {"body": 1, "float": 2}') == [1]
    assert found_in(tables, 'a = {"heading": 1, "depth": 2}') == []
