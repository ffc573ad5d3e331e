# SPDX-License-Identifier: Apache-2.0
"""Models of objects: what becomes an edge, what hides what, and what files say wrongly."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from strategies import poses

from plsing_ros.errors import GeometryError, SceneFileError
from plsing_ros.geometry.model import Model
from plsing_ros.geometry.model_files import read_model
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters import SceneParameters

CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], dtype=float)
QUADS = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
OBJ = "".join(f"v {x} {y} {z}\n" for x, y, z in CORNERS)
OBJ += "".join("f " + " ".join(f"{i + 1}/1/1" for i in face) + "\n" for face in QUADS)


def ends(model):
    """Return the edges as pairs of places, whatever the order of the vertices."""
    return {frozenset(tuple(np.round(model.vertices[i], 9)) for i in edge) for edge in model.edges}


@given(pose=poses(), size=st.floats(1e-3, 10.0), cuts=st.lists(st.booleans(), min_size=6, max_size=6))
def test_a_box_has_twelve_edges_however_its_faces_are_cut_and_wherever_it_is(pose, size, cuts):
    corners = size * CORNERS @ pose.rotation.T + pose.translation
    faces = []
    for face, cut in zip(QUADS, cuts, strict=True):
        a, b, c, d = face
        faces += [(a, b, c), (a, c, d)] if cut else [face]
    model = Model.from_faces(corners, faces)
    lengths = np.linalg.norm(model.vertices[model.edges[:, 0]] - model.vertices[model.edges[:, 1]], axis=1)
    assert len(model) == 12 and len(model.triangles) == 12
    np.testing.assert_allclose(lengths, size, rtol=1e-9)
    # Each edge borders two faces, of two triangles each.
    assert all(len(own) == 4 for own in model.edge_triangles)
    lines = model.lines()
    np.testing.assert_allclose(np.cross(model.vertices[model.edges[:, 0]], lines.direction), lines.moment, atol=1e-9)


def test_a_hollow_polygon_is_cut_into_triangles_of_the_same_area():
    outline = np.array([[0, 0], [3, 0], [3, 2], [2, 2], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
    model = Model.from_faces(np.column_stack([outline, np.zeros(8)]), [range(8)])
    a, b, c = (model.vertices[model.triangles[:, i]] for i in range(3))
    assert 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() == pytest.approx(5.0)
    assert len(model) == 8


def test_all_kinds_of_files_give_the_same_box(tmp_path):
    (tmp_path / "box.obj").write_text(OBJ)
    (tmp_path / "part.cao").write_text(
        "V1\n8 # points\n"
        + "\n".join(" ".join(map(str, each)) for each in CORNERS)
        + "\n0\n0\n6\n"
        + "\n".join("4 " + " ".join(map(str, face)) + " name=side" for face in QUADS)
        + "\n0\n0\n"
    )
    (tmp_path / "box.cao").write_text('# all in another file\nV1\nload("part.cao")\n0\n0\n0\n0\n0\n0\n')
    flat = ", ".join(", ".join(map(str, face)) + ", -1" for face in QUADS)
    numbers = ", ".join(str(each) for each in CORNERS.ravel())
    (tmp_path / "box.yaml").write_text(
        "/**:\n  ros__parameters:\n    scene_frame: part\n"
        f"    model:\n      vertices: [{numbers}]\n      faces: [{flat}]\n"
    )
    (tmp_path / "named.yaml").write_text("/**:\n  ros__parameters:\n    model:\n      file: box.obj\n")
    models = [read_model(tmp_path / name) for name in ("box.obj", "box.cao", "box.yaml", "named.yaml")]
    assert all(ends(model) == ends(models[0]) and len(model.triangles) == 12 for model in models)
    assert models[2].frame == "part"
    # The same file is a scene for all other nodes and commands, with the same ids and directions.
    lines, edges = read_scene(tmp_path / "named.yaml"), models[0].lines()
    parameters = SceneParameters.from_values({"model.file": str(tmp_path / "box.obj")})
    for scene in (lines, parameters.lines()):
        assert scene.ids == edges.ids == tuple(range(1, 13))
        np.testing.assert_allclose(scene.direction, edges.direction, atol=1e-12)
        np.testing.assert_allclose(scene.moment, edges.moment, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 x\n", "line 3"),
        ("a.obj", "v 0 0 0\nv 1 0 0\nf 1 2 3\n", "line 3: vertex 3 does not exist"),
        ("a.obj", "v 0 0 0\n", "no faces"),
        ("a.cao", "V2\n", "first line must be V1"),
        ("a.cao", "V1\n2\n0 0 0\n1 0\n", "line 4"),
        ("a.cao", "V1\n3\n0 0 0\n1 0 0\n0 1 0\n0\n0\n1\n3 0 1 5\n", "points 0 to 5"),
        ("a.cao", 'V1\nload("a.cao")\n', "loaded by a file"),
        ("a.yaml", "/**: {ros__parameters: {model: {vertices: [0, 0], faces: []}}}", "3 for each vertex"),
        ("a.yaml", "/**: {ros__parameters: {}}", "has no model"),
        ("a.stl", "", "known are"),
    ],
)
def test_a_wrong_file_is_refused_with_its_name_and_the_place(tmp_path, name, text, said):
    (tmp_path / name).write_text(text)
    with pytest.raises(SceneFileError, match=said) as refused:
        read_model(tmp_path / name)
    assert name in str(refused.value)


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (CORNERS, [(0, 1, 9)], "does not exist"),
        (CORNERS, [(0, 1)], "at least 3"),
        (CORNERS, [(0, 1, 1)], "no area"),
        (CORNERS, [(0, 1, 3, 6)], "not flat"),
        (np.vstack([CORNERS, [[np.nan, 0, 0]]]), QUADS, "finite"),
    ],
)
def test_what_is_no_object_is_refused(vertices, faces, said):
    with pytest.raises(GeometryError, match=said):
        Model.from_faces(vertices, faces)
