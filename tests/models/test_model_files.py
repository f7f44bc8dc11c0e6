"""Model files: what is written comes back, and nothing else is read."""

import json
import zipfile
from dataclasses import dataclass

import numpy as np
import pytest

from auv_gym.models import files as model_files
from auv_gym.models.files import forms, load_model, model_header, save_model
from auv_gym.models.linear import Polynomial, StateSpace
from auv_gym.param import replace_at
from auv_gym.plant import Plant, load_vehicle
from identification.recursive.diving_model import DivingModel

POLYNOMIAL = Polynomial(
    a=np.array([[[1.0]], [[-1.7]], [[0.1 + 0.2]]]),  # 0.30000000000000004: every bit counts
    b=np.array([[[0.0, 0.0]], [[1e-300, -3.25]]]),
    inputs=("bow_plane_rad", "stern_plane_rad"),
    outputs=("depth_m",),
    dt=4.0,
    output_offset=np.array([12.5]),
)
STATE_SPACE = StateSpace(
    a=np.array([[0.9, 0.1], [0.0, 0.7]]),
    b=np.array([[0.0], [1.0]]),
    c=np.array([[1.0, 0.0]]),
    inputs=("rudder_rad",),
    outputs=("heading_rad",),
    dt=0.5,
    k=np.array([[0.2], [0.1]]),
    states=("turned", "turning"),
)
DIVING = DivingModel(0.1, 0.2, -0.3, 0.4, -0.5, dt=0.7, scheme="difference")


@pytest.mark.parametrize("model", [POLYNOMIAL, STATE_SPACE, DIVING], ids=lambda m: type(m).__name__)
def test_what_is_written_comes_back_bit_for_bit(model, tmp_path):
    path = tmp_path / "model.npz"
    save_model(model, path, attrs={"method": "arx", "records": ["a.nc", "b.nc"]})
    again = load_model(path)
    assert type(again) is type(model)
    for name in model.__dataclass_fields__:
        given, found = getattr(model, name), getattr(again, name)
        if isinstance(given, np.ndarray):
            assert found.dtype == given.dtype
            np.testing.assert_array_equal(found, given)
        else:
            assert found == given
            assert type(found) is type(given)
    header = model_header(path)
    assert header["attrs"] == {"method": "arx", "records": ["a.nc", "b.nc"]}
    assert header["dt_s"] == model.dt
    assert list(header["inputs"]) == list(model.inputs)
    first = path.read_bytes()
    save_model(model, path, attrs={"method": "arx", "records": ["a.nc", "b.nc"]})
    assert path.read_bytes() == first
    assert [p.name for p in tmp_path.iterdir()] == ["model.npz"]


def test_units_of_channels_stand_in_the_header(tmp_path):
    save_model(POLYNOMIAL, tmp_path / "m.npz")
    header = model_header(tmp_path / "m.npz")
    assert header["outputs"] == {"depth_m": "m"}
    assert header["inputs"] == {"bow_plane_rad": "rad", "stern_plane_rad": "rad"}
    assert header["form"] == "polynomial"
    assert header["written_by"].startswith("auv-gym ")


def test_a_plant_is_a_vehicle_file(tmp_path):
    plant = replace_at(load_vehicle("slocum"), "effects.rudder.deadband", 0.05)
    save_model(plant, tmp_path / "v.toml")
    again = load_model(tmp_path / "v.toml")
    assert isinstance(again, Plant)
    assert np.array_equal(again.vector, plant.vector)
    assert load_model("slocum", dt=2.0) == load_vehicle("slocum", dt=2.0)
    with pytest.raises(ValueError, match=r"ends in \.toml"):
        save_model(plant, tmp_path / "v.npz")
    with pytest.raises(ValueError, match=r"ends in \.npz"):
        save_model(POLYNOMIAL, tmp_path / "v.toml")


def rewritten(path, **changes):
    """The model file with changes in its header; None takes the header away."""
    with np.load(path) as content:
        arrays = {name: content[name] for name in content.files}
    header = json.loads(arrays.pop("header").item()) | changes
    np.savez(path, header=np.array(json.dumps(header)), **arrays)
    return path


class Boom:
    """Raises when it is unpickled."""

    def __reduce__(self):
        return (exec, ("raise AssertionError('a model file ran code')",))


def test_a_file_never_runs_code(tmp_path):
    path = tmp_path / "evil.npz"
    save_model(POLYNOMIAL, path)
    with np.load(path) as content:
        arrays = {name: content[name] for name in content.files}
    np.savez(path, **{**arrays, "field_a": np.array([Boom()], dtype=object)})
    with pytest.raises(ValueError, match="Python objects, which can run code"):
        load_model(path)
    np.savez(path, header=np.array([Boom()], dtype=object))
    with pytest.raises(ValueError, match="Python objects, which can run code"):
        load_model(path)
    import pickle

    path.write_bytes(pickle.dumps(Boom()))
    with pytest.raises(ValueError, match=r"no \.npz file"):
        load_model(path)


def test_other_files_are_refused_in_words(tmp_path):
    path = tmp_path / "m.npz"
    with pytest.raises(ValueError, match="no file"):
        load_model(path)
    save_model(POLYNOMIAL, path)
    with pytest.raises(ValueError, match=r"Did you mean 'm\.npz'"):
        load_model(tmp_path / "mm.npz")
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="cut short"):
        load_model(path)
    path.write_bytes(b"")
    with pytest.raises(ValueError, match="cut short"):
        load_model(path)
    np.savez(path, x=np.zeros(3))
    with pytest.raises(ValueError, match="no model file"):
        load_model(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(ValueError, match="no model file"):
        load_model(path)
    folder = tmp_path / "folder.npz"
    folder.mkdir()
    with pytest.raises(ValueError, match="is a folder"):
        load_model(folder)


def test_no_damaged_byte_goes_unnoticed(tmp_path):
    path = tmp_path / "m.npz"
    save_model(POLYNOMIAL, path)
    whole, refusals = path.read_bytes(), []
    for at in range(0, len(whole), 5):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x55]) + whole[at + 1 :])
        try:
            found = load_model(path)
        except ValueError as error:
            refusals.append(str(error))
        else:  # a byte of the archive's dates or versions
            assert np.array_equal(found.a, POLYNOMIAL.a)
            assert np.array_equal(found.b, POLYNOMIAL.b)
            assert found.output_offset == POLYNOMIAL.output_offset
    assert len(refusals) > 0.6 * len(range(0, len(whole), 5))
    assert all(str(path) in words for words in refusals)


@pytest.mark.parametrize("packing", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_only_what_numpy_packs_is_unpacked(packing, tmp_path):
    """Others raise errors of their own kinds where a byte is damaged: Zstandard too, which Python 3.14 can unpack."""
    path, other = tmp_path / "m.npz", tmp_path / "other.npz"
    save_model(POLYNOMIAL, path)
    with zipfile.ZipFile(path) as archive, zipfile.ZipFile(other, "w", packing) as packed:
        for name in archive.namelist():
            packed.writestr(name, archive.read(name))
    with pytest.raises(ValueError, match=r"other\.npz is packed as save_model packs nothing"):
        load_model(other)


@pytest.mark.parametrize(
    "changes, words",
    [
        ({"version": 99, "written_by": "auv-gym 9.0"}, r"written by auv-gym 9\.0.*update auv-gym"),
        ({"version": "x"}, "update auv-gym"),
        ({"format": "something"}, "no model file"),
        ({"form": "polinomial"}, r"Did you mean 'polynomial'"),
        ({"form": 3}, "damaged"),
        ({"fields": {}}, "inputs"),
        ({"fields": {"inputs": ["rudder_rad"], "outputs": ["depth_m"], "dt": -1.0}}, "holds no valid Polynomial"),
        ({"fields": {"inputs": 3, "outputs": 4, "dt": 1.0}}, "holds no valid Polynomial"),
    ],
)
def test_headers_that_do_not_fit_are_refused(changes, words, tmp_path):
    path = tmp_path / "m.npz"
    save_model(POLYNOMIAL, path)
    with pytest.raises(ValueError, match=words):
        load_model(rewritten(path, **changes))


@dataclass(frozen=True)
class Still:
    """A model that never moves."""

    level: float
    dt: float = 1.0
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ("depth_m",)
    states: tuple[str, ...] = ()

    def initial(self, y0):
        return np.empty(0)

    def step(self, x, u):
        return x

    def output(self, x):
        return np.array([self.level])

    def correct(self, x, y):
        return x


class Entry:
    """An entry point as packages offer them."""

    def __init__(self, name, made):
        self.name, self.made = name, made

    def load(self):
        if isinstance(self.made, Exception):
            raise self.made
        return self.made


def test_forms_of_other_packages(tmp_path, monkeypatch):
    with pytest.raises(ValueError, match="Still has no form"):
        save_model(Still(2.0), tmp_path / "m.npz")
    entries = [Entry("still", Still), Entry("broken", ImportError("nothing there")), Entry("polynomial", Still)]
    monkeypatch.setattr(model_files, "entry_points", lambda group: entries if group == "auv_gym.models" else [])
    forms.cache_clear()
    try:
        assert forms()["polynomial"] is Polynomial  # ours keep their names
        assert "broken" not in forms()
        save_model(Still(2.0), tmp_path / "m.npz")
        assert load_model(tmp_path / "m.npz") == Still(2.0)
        with pytest.raises(ValueError, match="JSON"):
            save_model(Still(level=complex(0, 1)), tmp_path / "m.npz")
    finally:
        forms.cache_clear()
    monkeypatch.undo()
    with pytest.raises(ValueError, match="form 'still'"):
        load_model(tmp_path / "m.npz")
