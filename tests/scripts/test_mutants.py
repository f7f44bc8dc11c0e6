"""The mutants: what is noticed, what survives, what cannot be made; and that the list fits the tree."""

import ast
from pathlib import Path

import pytest

from scripts import mutants
from scripts.mutants import LIST, TREE, Mutant, Outcome, listed, main, mutated, study

WATCHED = Mutant("watched", "rule.py", "3.0", "0.0", "test_rule.py")
UNWATCHED = Mutant("unwatched", "rule.py", "a reason", "any reason", "test_rule.py")


@pytest.fixture
def tree(tmp_path) -> Path:
    """A tree of one rule and its test."""
    (tmp_path / "rule.py").write_text("SURE = 3.0  # for a reason\n")
    (tmp_path / "test_rule.py").write_text("import rule\n\n\ndef test_sure():\n    assert rule.SURE == 3.0\n")
    return tmp_path


@pytest.mark.slow
def test_a_watched_rule_is_noticed_and_an_unwatched_one_survives(tree, monkeypatch, capsys):
    monkeypatch.setattr(mutants, "TREE", tree)
    monkeypatch.setattr(mutants, "listed", lambda file: [WATCHED, UNWATCHED])
    assert main([]) == 1
    printed = capsys.readouterr()
    assert "2 mutants, 1 survived" in printed.out
    rows = {line.split()[0]: line.split()[-1] for line in printed.out.splitlines() if "rule.py" in line}
    assert rows == {"watched": "test_rule.py::test_sure", "unwatched": "SURVIVED"}
    assert "1 of 2, watched: test_rule.py::test_sure" in printed.err
    assert (tree / "rule.py").read_text() == "SURE = 3.0  # for a reason\n"


@pytest.mark.parametrize(
    "old, new, message", [("4.0", "0.0", "found it 0 times"), ("r", "s", "times"), ("=", "= =", "no Python")]
)
def test_a_mutant_that_cannot_be_made_is_refused(tree, old, new, message):
    with pytest.raises(ValueError, match=message):
        study(tree, [Mutant("bad", "rule.py", old, new, "test_rule.py")], print)


def test_tests_that_fail_without_a_mutant_are_refused(tree):
    (tree / "rule.py").write_text("SURE = 2.0  # for a reason\n")
    with pytest.raises(ValueError, match=r"test_rule\.py::test_sure fails"):
        study(tree, [UNWATCHED], print)


def test_one_mutant_alone_may_be_asked_for(monkeypatch, capsys):
    monkeypatch.setattr(mutants, "study", lambda tree, chosen, told: [Outcome(m, "a test") for m in chosen])
    assert main(["--only", "evidence doubled"]) == 0
    assert "1 mutants, 0 survived" in capsys.readouterr().out


def test_an_unknown_name_is_refused(capsys):
    assert main(["--only", "nonsense"]) == 2
    assert "no mutant is called nonsense; there are: significance off;" in capsys.readouterr().err


@pytest.mark.parametrize("mutant", listed(LIST), ids=lambda m: m.name)
def test_every_mutant_can_be_made_and_its_test_exists(mutant):
    assert mutated(TREE, mutant) != (TREE / mutant.file).read_text()
    file, _, name = mutant.test.partition("::")
    written = ast.walk(ast.parse((TREE / file).read_text()))
    functions = {node.name for node in written if isinstance(node, ast.FunctionDef)}
    assert name in functions or (not name and any(f.startswith("test_") for f in functions))
