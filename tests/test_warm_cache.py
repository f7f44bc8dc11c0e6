"""Programs of all presets are compiled before tests ask for them."""

import pytest

from auv_gym.plant import list_vehicles, load_vehicle
from tests.presets import UNCOMPILED
from tests.warm_cache import flown, main, one_of_each, program_of


def test_each_program_is_compiled_once():
    def program(name: str) -> str:
        return program_of(load_vehicle(name).family)

    taken = [program(name) for name in one_of_each()]
    assert len(set(taken)) == len(taken)
    daily = {name for name in list_vehicles() if name not in UNCOMPILED}
    assert set(taken) == {program(name) for name in daily}


def test_what_is_filtered_is_a_log_of_the_vehicle():
    plant = load_vehicle("ganeshblue")
    record = flown(plant)
    assert all(record.has(name) for name in (*plant.inputs, *plant.outputs))


def test_it_says_what_it_has_compiled(capsys):
    assert main(["ganeshblue", "--jobs", "1"]) == 0
    assert "ganeshblue are in the cache" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, said", [(["submarine"], "no preset submarine: one of bluerov"), (["--jobs", "0"], "from 1 up, got 0")]
)
def test_bad_input_is_refused(arguments, said, capsys):
    with pytest.raises(SystemExit):
        main(arguments)
    assert said in capsys.readouterr().err
