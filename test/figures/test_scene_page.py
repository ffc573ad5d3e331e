# SPDX-License-Identifier: Apache-2.0
"""The interactive page, in a real browser."""

import io
import re
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from browser import ask_page, png_of

from paper.scenes import four_lines, three_lines
from plsing_ros.errors import PlsingError
from plsing_ros.figures.locus_widths import width_triangles
from plsing_ros.figures.scene_page import save_scene_page
from plsing_ros.singularities import Kind, singular_set

DRAWN = "document.querySelector('.js-plotly-plot .gl-container canvas') !== null"
SCREENSHOT = """{
    traces: document.querySelector('.js-plotly-plot')._fullData.map((t) => [t.name, t.visible === true, t.x.length]),
    image: await Plotly.toImage(document.querySelector('.js-plotly-plot'), {format: 'png', width: 900, height: 700}),
    empty: await Plotly.toImage({data: [], layout: {}}, {format: 'png', width: 900, height: 700}),
}"""


def page(tmp_path):
    path = np.column_stack([np.linspace(0.0, 5.0, 50), np.linspace(0.0, 3.0, 50), np.full(50, 4.0)])
    singular = singular_set(four_lines())
    return save_scene_page(
        tmp_path / "scene.html", "A scene", singular, singular_set(three_lines()).surfaces, [("a path", path)]
    )


def test_a_browser_draws_the_scene(tmp_path):
    try:
        import kaleido
    except ImportError:
        pytest.fail(
            "the page is opened in the browser of the package kaleido, which is missing: pip install kaleido==0.2.1"
        )
    executable = Path(kaleido.__file__).parent / "executable" / "kaleido"
    answer = ask_page(executable, page(tmp_path), tmp_path, DRAWN, SCREENSHOT)
    assert "Chrome" in answer.agent
    assert answer.errors == []
    traces = {name: (visible, points) for name, visible, points in answer.value["traces"]}
    # The lines are known exactly, so that what is beside a locus is of less interest.
    widths = {name: traces.pop(name)[0] for name in list(traces) if name.startswith("within ")}
    assert len(widths) == 7 and not any(widths.values())
    assert set(traces) == {
        *(f"line {i}" for i in range(1, 5)),
        "transversal 1",
        "transversal 2",
        "isolated points",
        "quadric",
        "cubic surface",
        "a path",
    }
    assert traces["isolated points"] == (True, 5)  # the sixth is 116 m away
    assert traces["quadric"][0] and not traces["cubic surface"][0]
    assert traces["quadric"][1] > 500 and traces["cubic surface"][1] > 500
    image, empty = (
        matplotlib.image.imread(io.BytesIO(png_of(answer.value[name])))[..., :3] for name in ("image", "empty")
    )
    assert image.shape == (700, 900, 3)
    assert (np.abs(image - empty).max(axis=2) > 0.1).mean() > 0.1
    # Colours of the observed lines, the transversals, the isolated points and the path.
    for color in ((0, 0, 0), (255, 140, 0), (255, 0, 0), (31, 119, 180)):
        near = np.abs(image - np.array(color) / 255.0).max(axis=2) < 0.06
        assert near.sum() > 15, color


def test_the_page_needs_no_network(tmp_path):
    text = page(tmp_path).read_text(encoding="utf-8")
    # Not in the assertions, which would explain five million characters.
    fetched = re.findall(r"<(?:script|img|iframe)[^>]{0,200}\ssrc=[^>]{0,80}|<link[^>]{0,80}", text)
    named = "a path" in text
    assert fetched == [] and named


def test_a_page_that_cannot_be_written_is_named(tmp_path):
    with pytest.raises(PlsingError, match="page"):
        save_scene_page(tmp_path / "missing" / "scene.html", "A scene", singular_set(four_lines()))


def test_widths_are_drawn_as_far_from_a_locus_as_they_are_said_to_be():
    for singular in (singular_set(four_lines()), singular_set(three_lines())):
        for locus in singular.loci:
            corners = width_triangles(locus, singular.frame.center, 50.0, 3.0).reshape(-1, 3)
            if locus.kind is not Kind.CUBIC and len(corners):
                distances = [locus.distance(corner) for corner in corners[:: max(len(corners) // 50, 1)]]
                # A quadric's distance is one of first order.
                tolerance = 0.2 if locus.kind is Kind.QUADRIC else 1e-6
                np.testing.assert_allclose(distances, locus.half_width, rtol=tolerance)
