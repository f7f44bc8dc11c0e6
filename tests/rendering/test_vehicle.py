"""The drawing of a vehicle follows from its parts."""

from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from auv_gym.cli import main
from auv_gym.plant import load_vehicle
from auv_gym.rendering.vehicle import draw_vehicle

FILES = Path(__file__).parents[2] / "examples" / "vehicles"


@pytest.mark.parametrize("name", ["npsauv", FILES / "tethys.toml", "seawing"])
def test_every_part_is_drawn_where_its_file_puts_it_or_named_as_not_drawn(name):
    plant = load_vehicle(name)
    above, side = draw_vehicle(plant).axes
    named = [text.get_text() for text in above.texts]
    for part in plant.family.body.parts:
        own, title = getattr(plant.parts, part.name), part.title
        if not part.found.sketch(own):
            assert title in side.get_title(loc="right")
            continue
        assert title in named
        place = [getattr(own, key) for key in part.found.place]
        if place and part.kind in ("fin", "buoyancy_engine"):
            middles = [np.mean(line.get_xydata()[:4], axis=0) for line in above.lines]
            assert any(np.allclose(middle, place[:2], atol=1e-9) for middle in middles)
    assert (above.get_ylabel(), side.get_ylabel()) == ("starboard, m", "down, m")


@pytest.mark.parametrize("name", ["remus100", "bluerov2_heavy"])
def test_names_neither_overlap_nor_leave_the_picture(name):
    figure = draw_vehicle(load_vehicle(name))
    FigureCanvasAgg(figure).draw()
    for axes in figure.axes:
        boxes = [text.get_bbox_patch().get_window_extent() for text in axes.texts]
        assert len(boxes) > 1
        assert not any(a.overlaps(b) for k, a in enumerate(boxes) for b in boxes[:k])
        assert all(axes.bbox.y0 < box.y0 and box.y1 < axes.bbox.y1 for box in boxes)
    title = figure._suptitle.get_window_extent()
    assert figure.bbox.x0 < title.x0
    assert title.x1 < figure.bbox.x1


def test_the_command_writes_the_picture_or_says_why_not(tmp_path, capsys):
    assert main(["draw", "remus100", "--out", str(tmp_path / "remus.svg")]) == 0
    assert "rudder" in (tmp_path / "remus.svg").read_text() or (tmp_path / "remus.svg").stat().st_size > 10_000
    assert [path.name for path in tmp_path.iterdir()] == ["remus.svg"]
    assert main(["draw", "slocum", "--out", str(tmp_path / "glider.png")]) == 1
    assert (
        "A drawing needs a vehicle with a hull and parts, such as remus100; slocum has none" in capsys.readouterr().err
    )
    assert main(["draw", "remus100", "--out", str(tmp_path / "remus.jpg")]) == 1
    assert "--out needs a name that ends in .png, .svg, .pdf, got 'remus.jpg'" in capsys.readouterr().err
