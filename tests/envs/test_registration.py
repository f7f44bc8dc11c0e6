import subprocess
import sys
from importlib import metadata

import pytest

NAME = "auv_gym/GliderHeading-v0"


def python(code):
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()


def test_gymnasium_imports_the_package_by_the_name_before_the_colon():
    assert python(f"import gymnasium; print(gymnasium.make('auv_gym.envs:{NAME}').spec.id)") == NAME


@pytest.mark.parametrize("first, second", [("auv_gym.envs", "gymnasium"), ("auv_gym.autoload", "gymnasium")])
@pytest.mark.parametrize("turned", [False, True])
def test_the_environment_is_known_in_whatever_order_of_imports(first, second, turned):
    modules = f"{second}, {first}" if turned else f"{first}, {second}"
    assert python(f"import {modules}; print(gymnasium.spec('{NAME}').id)") == NAME


def test_waiting_for_gymnasium_imports_nothing_heavy():
    heavy = python(
        "import auv_gym.autoload, sys\n"
        "print([m for m in ('numpy', 'numba', 'gymnasium', 'xarray') if m in sys.modules])"
    )
    assert heavy == "[]"


def test_gymnasiums_module_is_left_as_it_was():
    loader = python(
        "import auv_gym.autoload, gymnasium, sys\n"
        "module = sys.modules['gymnasium.envs.registration']\n"
        "watching = [f for f in sys.meta_path if type(f).__module__ == 'auv_gym.autoload']\n"
        "print(type(module.__loader__).__name__, type(module.__spec__.loader).__name__, watching)"
    )
    assert loader == "SourceFileLoader SourceFileLoader []"


def test_an_installed_package_is_found_without_an_import(tmp_path):
    try:
        files = metadata.files("auv-gym") or []
    except metadata.PackageNotFoundError:
        files = []
    if not any(file.name == "auv_gym_autoload.pth" for file in files):
        pytest.skip("auv-gym is not installed here: pip install -e .")
    code = f"import gymnasium; print(gymnasium.make('{NAME}').spec.id)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.strip() == NAME
