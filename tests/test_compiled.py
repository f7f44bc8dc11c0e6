"""The cache of compiled code: found again, renewed when a callee changes, done without where it cannot be written."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

from auv_gym import compiled as compiled_module
from auv_gym.compiled import JIT, bind, compiled, for_vector, view_as

ROOT = Path(__file__).parents[1]
pytestmark = pytest.mark.skipif(not JIT, reason="AUV_GYM_JIT=0: nothing is compiled")

INNER = """from auv_gym.compiled import compiled


@compiled
def added(x):
    return x + {number}
"""
OUTER = """from auv_gym.compiled import bind, compiled
from toy.inner import added


@compiled
def doubled(x):
    return 2.0 * added(x)
"""
RUN = """import json
from toy.outer import doubled
from auv_gym.compiled import bind
from toy.inner import added

hook = None
def template(x):
    return hook(x) + 0.5
template.__module__ = "auv_gym.plant.rollout"  # as if a family outside the package had brought the hook
bound = bind(template, "toy", hook=added)
counts = lambda function: (function.ready.stats.cache_hits, function.ready.stats.cache_misses)
stats = lambda function: [sum(count.values()) for count in counts(function)]
print(json.dumps([doubled(1.0), bound(1.0), stats(doubled)]))
"""


@pytest.fixture
def toy(tmp_path):
    """A package of its own outside the project: returns a function that runs it in a new process."""
    package = tmp_path / "toy"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "inner.py").write_text(INNER.format(number="1.0"))
    (package / "outer.py").write_text(OUTER)
    (tmp_path / "run.py").write_text(RUN)

    def run(**environment):
        paths = os.pathsep.join([str(tmp_path), str(ROOT)])
        environment = {**os.environ, "PYTHONPATH": paths, "AUV_GYM_CACHE": str(tmp_path / "cache"), **environment}
        done = subprocess.run(
            [sys.executable, str(tmp_path / "run.py")], env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    run.package = package
    return run


def test_the_cache_is_found_again_and_renewed_by_an_edit_in_a_callee(toy):
    assert toy() == [4.0, 2.5, [0, 1]]
    assert toy() == [4.0, 2.5, [1, 0]]
    (toy.package / "inner.py").write_text(INNER.format(number="10.0"))
    assert toy() == [22.0, 11.5, [0, 1]]


def test_an_unwritable_cache_folder_is_done_without(toy, tmp_path):
    nowhere = {"AUV_GYM_CACHE": os.devnull, "XDG_CACHE_HOME": os.devnull, "HOME": os.devnull}
    temporary = tmp_path / "tmp"
    temporary.mkdir()
    assert toy(**nowhere, TMPDIR=str(temporary)) == [4.0, 2.5, [0, 1]]
    assert not list(temporary.glob("auv-gym-*"))


SHARED = """import json, sys
import numpy as np
from auv_gym.compiled import bind, outlined, view_as

@outlined
def long(record):  # enough not to be compiled into its caller
    total = record.last
{lines}
    return total

view = None
def read(vector):
    return long(view(vector))
read.__module__ = "auv_gym.plant.rollout"  # as of a vehicle

def reader(count):
    layout = np.dtype((np.record, [("first", np.float64, (count,)), ("last", np.float64)]))
    return bind(read, f"of{{count}}", view=view_as(layout, f"of{{count}}"))

print(json.dumps([float(reader(int(count))(np.arange(9.0))) for count in sys.argv[1:]]))
"""


def test_code_for_two_layouts_from_two_processes_is_told_apart(tmp_path):
    """What each layout's process has compiled, a third process uses together."""
    lines = "\n".join(f"    total = np.sin({k}.0 + total) * record.last" for k in range(40))
    (tmp_path / "shared.py").write_text(SHARED.format(lines=lines))

    def run(*counts):
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "AUV_GYM_CACHE": str(tmp_path / "cache")}
        command = [sys.executable, str(tmp_path / "shared.py"), *counts]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    alone = [*run("2"), *run("5")]
    assert alone[0] != alone[1]
    assert run("2", "5") == alone


def test_two_processes_that_compile_at_once_write_to_two_files(tmp_path, monkeypatch):
    """Both have read the index before either has written to it."""

    @compiled
    def doubled(x):
        return 2 * x

    files = doubled.ready._cache._cache_file
    monkeypatch.setattr(files, "_load_index", dict)
    monkeypatch.setattr(files, "_cache_path", str(tmp_path))
    monkeypatch.setattr(files, "_index_path", str(tmp_path / "index"))
    for process, number in ((11, 2), (12, 2.0)):
        monkeypatch.setattr(os, "getpid", lambda process=process: process)
        files.save(type(number), number)
    kept = [files._load_data(path.name) for path in sorted(tmp_path.glob("*.nbc"))]
    assert kept == [2, 2.0]


def test_old_generations_of_the_cache_are_removed(tmp_path):
    for age in range(9):
        folder = tmp_path / f"generation{age}"
        folder.mkdir()
        (folder / "code.nbi").touch()
        os.utime(folder, (1e9 - age, 1e9 - age))
    compiled_module._forget_old_generations(tmp_path)
    assert sorted(folder.name for folder in tmp_path.iterdir()) == [f"generation{age}" for age in range(6)]
    compiled_module._forget_old_generations(tmp_path / "none")  # another process may have removed it


def test_other_packages_keep_their_cache_folder():
    folder_of_others = numba.config.CACHE_DIR

    @compiled
    def one():
        return 1.0

    assert folder_of_others == numba.config.CACHE_DIR
    assert str(one.ready._cache.cache_path).startswith(
        str(compiled_module._cache_folder(frozenset({Path(__file__).parent})))
    )


scale = offset = None


def line(x):
    """A template with two open names."""
    return scale * x + offset


def test_a_template_takes_its_meanings():
    steep, flat = bind(line, "steep", scale=3.0, offset=1.0), bind(line, "flat", scale=0.0, offset=2.0)
    assert (steep(2.0), flat(2.0), steep(1.0)) == (7.0, 2.0, 4.0)
    assert (steep.__name__, steep.__doc__) == ("line_steep", line.__doc__)
    assert scale is None


def test_division_by_zero_is_infinite_as_numpy_has_it():
    @compiled
    def inverse(x):
        return 1.0 / x

    assert inverse(0.0) == np.inf


def test_a_view_is_not_a_copy_and_follows_its_layout():
    one = view_as(np.dtype((np.record, [("a", np.float64), ("b", np.float64)])), "pair")
    two = view_as(np.dtype((np.record, [("b", np.float64), ("a", np.float64)])), "pair")
    vector = np.array([1.0, 2.0])
    assert (one(vector).a, two(vector).a) == (1.0, 2.0)
    assert one.__name__ != two.__name__


def test_a_program_is_kept_once_however_it_is_called(tmp_path, monkeypatch):
    monkeypatch.setattr(compiled_module, "_cache_folder", lambda packages: tmp_path)
    first, again = (bind(line, "once", scale=3.0, offset=1.0) for _ in range(2))
    assert for_vector(first)(np.ones(2)).tolist() == [4.0, 4.0]
    assert again(np.ones(2)).tolist() == [4.0, 4.0]
    assert sum(again.ready.stats.cache_hits.values()) == 1
    assert sum(again.ready.stats.cache_misses.values()) == 0


def test_names_may_be_of_any_length():
    """A vehicle of many kinds of parts has one that no file could have."""
    long = 300 * "x"
    steep, flat = bind(line, long + "1", scale=3.0, offset=1.0), bind(line, long + "2", scale=0.0, offset=2.0)
    assert (steep(2.0), flat(2.0)) == (7.0, 2.0)


def test_what_compiled_code_calls_is_made_callable_from_python_only_where_python_calls_it(tmp_path, monkeypatch):
    """The code around it that does so takes a quarter of the time of compiling a vehicle."""
    monkeypatch.setattr(compiled_module, "_cache_folder", lambda packages: tmp_path)  # of cached code nothing is told

    @compiled
    def squared(x):
        return x * x

    @compiled
    def above_squared(x):
        return squared(x) + 1.0

    def for_python(function):
        (found,) = function.overloads.values()
        return found.fndesc.llvm_cpython_wrapper_name in found.library.get_llvm_str()

    assert above_squared(3.0) == 10.0
    assert for_python(above_squared.ready)
    assert not for_python(squared.within)
    assert "ready" not in vars(squared)
    assert squared(3.0) == 9.0
    assert for_python(squared.ready)


def calling(x):
    return hook(x)


hook = None


def test_what_compiled_code_calls_is_not_found_in_the_cache_by_python(tmp_path, monkeypatch):
    """It cannot call that, and numba takes the two for the same."""
    monkeypatch.setattr(compiled_module, "_cache_folder", lambda packages: tmp_path)
    first, again = (bind(line, "within", scale=3.0, offset=1.0) for _ in range(2))
    assert bind(calling, "within", hook=first)(2.0) == 7.0
    again.ready.compile((numba.float64,))  # calling what was made for compiled code would end the process
    assert sum(again.ready.stats.cache_hits.values()) == 0
    assert again(2.0) == 7.0
