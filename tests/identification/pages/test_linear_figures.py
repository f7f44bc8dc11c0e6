"""Pictures of linear models: what is in a panel, where it looks, and how far a band may widen it."""

from dataclasses import replace

import numpy as np
import pytest

from auv_gym.models.linear import Polynomial, linearise
from auv_gym.plant import load_vehicle
from identification.linear.polynomials.arx import Arx
from identification.linear.polynomials.orders import search_orders
from identification.linear.uncertainty import response_band
from tests.identification.linear.known_systems import INPUTS, OUTPUTS, TRUTH, record_of

pytest.importorskip("matplotlib", reason="the extra `render` is not installed")
from identification.pages.linear_figures import bode_figure, pole_zero_figure
from identification.pages.model_figures import rollout_figure
from identification.pages.order_figures import order_figure, singular_value_figure


@pytest.fixture(scope="module")
def record():
    return record_of(TRUTH, 500, np.random.default_rng(0), noise=0.02)


@pytest.fixture(scope="module")
def fit(record):
    return Arx(INPUTS, OUTPUTS, n_a=[3, 2], integrating=("depth_m",)).fit(record)


def marks(axes, marker):
    return np.concatenate([line.get_xydata() for line in axes.lines if line.get_marker() == marker])


def test_every_output_and_input_has_its_poles_and_zeros(fit):
    figure = pole_zero_figure({"arx": fit})
    assert [axes.get_title(loc="left") for axes in figure.axes] == [
        f"{output} by {given}" for output in ("depth", "pitch") for given in ("bow plane", "stern plane")
    ]
    depth, _, pitch, _ = figure.axes
    assert len(marks(depth, "x")) == 3
    assert len(marks(pitch, "x")) == 2
    assert len(marks(depth, "o")) == 1
    assert np.ptp(depth.get_xlim()) == pytest.approx(np.ptp(depth.get_ylim()))
    assert len(pitch.patches) == 2  # the regions of a pair
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == ["poles", "zeros", "95 % region of a pole"]


def test_a_panel_looks_at_the_slow_poles_and_tells_of_the_others():
    vehicle = linearise(load_vehicle("npsauv"), dt=0.1)
    figure = pole_zero_figure({"vehicle": vehicle})
    axes = figure.axes[0]
    assert axes.get_xlim()[0] > 0.9
    assert "poles 0.368 (2 times)" in " ".join(axes.get_xlabel().split())
    spread = Polynomial.from_coefficients({"pitch_rad": [0.0, 0.81]}, {"pitch_rad": {"stern_plane_rad": [1.0]}}, dt=1.0)
    (whole,) = pole_zero_figure({"spread": spread}).axes
    assert whole.get_xlim() == pytest.approx((-1.15, 1.15))
    with pytest.raises(ValueError, match="at least one"):
        pole_zero_figure({})


def test_a_response_goes_to_nyquist_with_its_unit_and_band(fit):
    figure = bode_figure({"arx": fit, "truth": TRUTH})
    gains, phases = figure.axes[:2], figure.axes[2:4]
    assert gains[0].get_title(loc="left") == "depth by bow plane\ngain, dB re 1 m/rad"
    assert phases[0].get_title(loc="left") == "phase, deg"
    assert gains[0].get_xlim()[1] == pytest.approx(np.pi / 4.0)
    omega, shown = gains[1].lines[0].get_data()
    band = response_band(fit, omega)
    np.testing.assert_allclose(shown, 20.0 * np.log10(band.gain[:, 0, 1]), atol=1e-9)
    assert [len(axes.collections) for axes in (*gains, *phases)] == [1] * 4  # a known model has no band
    omega = [0.01, 0.1]
    assert bode_figure({"arx": fit}, omega).axes[0].lines[0].get_xdata().tolist() == omega


def test_a_band_without_limits_leaves_the_line_readable(fit):
    wild = replace(fit, covariance=1e6 * fit.covariance)
    for axes in bode_figure({"arx": wild}).axes:
        low, high = axes.get_ylim()
        values = axes.lines[0].get_ydata()
        assert np.ptp(values) > 0.25 * (high - low) or high - low < 200.0
    pole_zero_figure({"arx": wild}).canvas.draw()


def test_an_input_without_effect_says_so(record):
    fit = Arx(INPUTS, OUTPUTS, n_a=[3, 2], n_b=[[2, 2], [0, 2]]).fit(record)
    axes = bode_figure({"arx": fit}).axes[4]
    assert [text.get_text() for text in axes.texts] == ["no response"]


def test_choices_of_orders_are_marked(record):
    search = search_orders("arx", [record], INPUTS, OUTPUTS, n_a=[1, 2, 3], n_b=[1, 2])
    figure = order_figure(search)
    assert len(figure.axes) == 4
    errors, criteria = figure.axes[:2]
    assert errors.get_title(loc="left") == "error of depth one step ahead, m"
    best = search.best("depth_m", "mdl")
    spots = [line.get_xydata()[0] for line in criteria.lines if line.get_label() == "MDL"]
    assert spots[0] == pytest.approx([best.parameters, np.sqrt(best.mdl)])
    validated = search_orders("arx", [record], INPUTS, OUTPUTS[1:], n_a=[2], n_b=[1, 2], validate=[record])
    assert figure_titles(order_figure(validated))[-1] == "free runs of pitch, held-out fit, %"


def test_singular_values_that_are_kept_are_told_apart():
    class Found:
        singular_values, order = np.array([1.0, 0.9, 0.1, 0.0]), 2

    (axes,) = singular_value_figure(Found()).axes
    kept = next(line for line in axes.lines if line.get_label() == "kept: order 2")
    assert kept.get_ydata().tolist() == [1.0, 0.9]
    assert min(axes.lines[0].get_ydata()) > 0.0  # a zero has a place on a logarithmic axis


def test_a_wide_band_of_a_free_run_does_not_flatten_it(record):
    half = {"arx": {"pitch_rad": np.full(len(record), 50.0)}}
    plain = rollout_figure(record, {"arx": record}, ["pitch_rad"], "measured").axes[0].get_ylim()
    banded = rollout_figure(record, {"arx": record}, ["pitch_rad"], "measured", half).axes[0]
    assert np.ptp(banded.get_ylim()) == pytest.approx(2.0 * np.ptp(plain))
    assert len(banded.collections) == 1


def figure_titles(figure) -> list[str]:
    return [axes.get_title(loc="left") for axes in figure.axes]
