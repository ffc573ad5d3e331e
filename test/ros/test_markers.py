# SPDX-License-Identifier: Apache-2.0
"""Markers against what RViz and Foxglove need: frames, scales, colours, orientations, points, lifetimes."""

import json

import numpy as np
import pytest
import yaml
from matplotlib import image
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.levels import Level
from plsing_ros.nodes.markers import CameraMarkers, scene_markers
from plsing_ros.parameters.config_files import config_file
from plsing_ros.singularities import singular_set

PAPER = singular_set(read_scene(config_file("paper_p4l.yaml")))
THREE = singular_set(PAPER.lines.select([0, 1, 2]))
CORRIDOR = singular_set(LineSet.from_points_directions([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 1]] * 3))
# Near-singular: a window of five bars whose plane is singular, measured, and four edges of a shaft with others.
WINDOW = ([[0, 0, 0], [0, 0, 1.2], [0, 0, 0], [0.9, 0, 0], [0.4, 0, 0]], [[1, 0, 0]] * 2 + [[0, 0, 1]] * 3)
SHAFT = (
    [[0, 0, 0], [4, 0, 0], [0, 3, 0], [4, 3, 0], [2, 0, 8], [2, 3, 8], [0, 1.5, 8], [4, 1.5, 8]],
    [[0, 0, 1]] * 4 + [[1, 0, 0]] * 2 + [[0, 1, 0]] * 2,
)
HEAD = Header(frame_id="world")
LISTS = {Marker.LINE_LIST: 2, Marker.TRIANGLE_LIST: 3, Marker.LINE_STRIP: 1, Marker.SPHERE_LIST: 1}


def camera_markers(level=Level.OK, unobservable_motion=None, poses=5):
    camera = CameraMarkers(PAPER)
    for step in range(poses):
        pose = Pose(np.eye(3), np.array([0.1 * step, 0.0, 5.0]))
        array = camera.markers(pose, level, "OK: fine", unobservable_motion, HEAD)
    return array.markers


ALL = {
    "four lines": scene_markers(PAPER, HEAD).markers,
    "three lines": scene_markers(THREE, HEAD).markers,
    "corridor": scene_markers(CORRIDOR, HEAD).markers,
    "exact window": scene_markers(singular_set(LineSet.from_points_directions(*WINDOW)), HEAD).markers,
    "exact shaft": scene_markers(singular_set(LineSet.from_points_directions(*SHAFT)), HEAD).markers,
    "camera": camera_markers(),
    "camera losing a motion": camera_markers(Level.CRITICAL, np.array([0, 0, 1.0, 0, 0, 0])),
    "camera that rotates unseen": camera_markers(Level.STALE, np.array([0, 0, 0, 0, 0, 1.0])),
    "first pose": camera_markers(poses=1),
}


@pytest.mark.parametrize("name", list(ALL))
def test_every_marker_can_be_drawn(name):
    keys = set()
    for marker in ALL[name]:
        assert marker.header.frame_id == "world"
        if marker.action in (Marker.DELETEALL, Marker.DELETE):
            continue
        assert marker.frame_locked and (marker.header.stamp.sec, marker.header.stamp.nanosec) == (0, 0)
        assert marker.color.a > 0.0
        assert marker.pose.orientation.w == 1.0
        assert min(marker.scale.x, marker.scale.y, marker.scale.z) > 0.0
        assert (marker.lifetime.sec, marker.lifetime.nanosec) == (0, 0)  # until replaced
        numbers = [value for point in marker.points for value in (point.x, point.y, point.z)]
        assert np.isfinite(numbers).all()
        if marker.type in LISTS:
            assert len(marker.points) >= 1
            assert len(marker.points) % LISTS[marker.type] == 0
            assert len(marker.colors) in (0, len(marker.points))
        if marker.type == Marker.ARROW:
            assert len(marker.points) == 2
        if marker.type == Marker.TEXT_VIEW_FACING:
            assert marker.text
        keys.add((marker.ns, marker.id))
    assert len(keys) == sum(marker.action == Marker.ADD for marker in ALL[name])


def test_what_is_drawn_is_what_was_found():
    assert ALL["four lines"][0].action == Marker.DELETEALL  # nothing of an earlier scene stays
    namespaces = [marker.ns for marker in ALL["four lines"]]
    assert (namespaces.count("transversals"), namespaces.count("isolated_points")) == (2, 6)
    assert [marker.ns for marker in ALL["three lines"]].count("surfaces") == 2
    assert {marker.ns for marker in ALL["corridor"]} == {"", "observed_lines", "labels"}


def test_every_locus_in_reach_is_labelled_with_its_name_at_its_place():
    labels = {marker.text: marker.pose.position for marker in ALL["four lines"] if marker.ns == "labels"}
    center, reach = PAPER.frame.center, 6.0 * PAPER.frame.length
    for name, place in zip(PAPER.locus_names, PAPER.distance_arrays(center).closest_point, strict=True):
        assert (name in labels) == (np.linalg.norm(place - center) <= reach)
        if name in labels:
            at = labels[name]
            # Just above it: distance_arrays measures how far the label is from the locus that it names.
            distances = dict(zip(PAPER.locus_names, PAPER.distance_arrays([at.x, at.y, at.z]).distance, strict=True))
            assert distances[name] <= 0.03 * reach
    assert {"transversal 1", "line 1", "isolated point 1"} <= set(labels)


def test_five_lines_that_no_line_meets_show_the_one_that_nearly_does():
    lines = read_scene(config_file("small_object.yaml")).select([0, 1, 2, 3, 6, 7])
    singular = singular_set(lines)
    (dashes,) = [each for each in scene_markers(singular, HEAD).markers if each.ns == "nearest_transversal"]
    points = np.array([[p.x, p.y, p.z] for p in dashes.points])
    near = singular.nearest_transversal
    assert np.abs(np.cross(points - near.point, near.direction)).max() < 1e-9 * singular.frame.length
    assert not any(each.ns == "nearest_transversal" for each in ALL["four lines"])


def measured(scene):
    """A scene whose lines are off by less than they are known to be."""
    points, directions = (np.array(each, dtype=float) for each in scene)
    off = np.random.default_rng(0)
    return singular_set(
        LineSet.from_points_directions(
            points + 1e-3 * off.normal(size=points.shape),
            directions + 1e-3 * off.normal(size=points.shape),
            position_std=1e-3,
            direction_std=1e-3,
        )
    )


@pytest.mark.parametrize(("scene", "namespace", "name"), [(WINDOW, "surfaces", "plane"), (SHAFT, "curves", "circle")])
def test_what_is_singular_within_the_tolerances_is_drawn_paler_at_its_place(scene, namespace, name):
    exact, near = singular_set(LineSet.from_points_directions(*scene)), measured(scene)
    (pale,) = [each for each in scene_markers(near, HEAD).markers if each.ns == namespace]
    (full,) = [each for each in scene_markers(exact, HEAD).markers if each.ns == namespace]
    assert pale.type == full.type and pale.color != full.color
    points = np.array([[p.x, p.y, p.z] for p in pale.points])
    assert len(points) >= 24
    # On the exact scene's locus, a plane or circle known by hand, as far as the tolerances let it move.
    off = points[:, 1] if name == "plane" else np.hypot(points[:, 0] - 2.0, points[:, 1] - 1.5) - 2.5
    assert np.abs(off).max() < 0.02 * np.abs(points).max()
    assert name in [each.text for each in scene_markers(near, HEAD).markers if each.ns == "labels"]


def test_a_status_of_several_reasons_has_several_lines():
    camera = CameraMarkers(PAPER)
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 5.0]))
    markers = camera.markers(pose, Level.WARN, "WARN: near; 0.2 m from transversal 1", None, HEAD).markers
    (note,) = [each for each in markers if each.ns == "status"]
    assert note.text.splitlines() == ["WARN: near", "0.2 m from transversal 1"]


def drawn(markers):
    """A picture of markers as a viewer draws them, seen along the y axis: what each marker colours, by namespace."""
    figure = Figure(figsize=(6, 6), dpi=100)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes([0, 0, 1, 1], projection="3d")
    axes.set_axis_off()
    for marker in markers:
        points = np.array([[p.x, p.y, p.z] for p in marker.points]).reshape(-1, 3)
        color = (marker.color.r, marker.color.g, marker.color.b, marker.color.a)
        if marker.type == Marker.LINE_LIST:
            axes.add_collection3d(Line3DCollection(points.reshape(-1, 2, 3), colors=[color]))
        elif marker.type == Marker.LINE_STRIP:
            axes.plot(*points.T, color=color)
        elif marker.type == Marker.SPHERE_LIST:
            axes.scatter(*points.T, color=color, s=20)
        elif marker.type == Marker.TRIANGLE_LIST:
            axes.add_collection3d(Poly3DCollection(points.reshape(-1, 3, 3), facecolors=color))
        elif marker.type == Marker.ARROW:
            axes.quiver(*points[0], *(points[1] - points[0]), color=color)
        elif marker.type == Marker.TEXT_VIEW_FACING:
            p = marker.pose.position
            axes.text(p.x, p.y, p.z, marker.text, color=color, fontsize=7)
    axes.auto_scale_xyz(*np.array([[-5, 5]] * 3))
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())


def test_a_picture_of_the_markers_shows_them(tmp_path):
    """Each marker is seen: the picture without it is another one."""
    markers = [each for each in ALL["four lines"] + ALL["camera losing a motion"] if each.action == Marker.ADD]
    whole = drawn(markers)
    image.imsave(tmp_path / "markers.png", whole)
    assert (whole[..., :3] < 250).any(axis=-1).mean() > 0.01
    for left_out in markers:
        points = np.array([[p.x, p.y, p.z] for p in left_out.points])
        if left_out.ns == "labels" or (left_out.ns == "isolated_points" and np.abs(points).max() > 5.0):
            continue  # the latter are outside the picture
        without = drawn([each for each in markers if each is not left_out])
        assert (without != whole).any(axis=-1).sum() > 10, left_out.ns


def test_the_mesh_of_a_surface_lies_on_it():
    quadric = next(marker for marker in ALL["three lines"] if marker.ns == "surfaces")
    points = np.array([[p.x, p.y, p.z] for p in quadric.points])
    surface = THREE.surfaces[0]
    size = np.linalg.norm(surface.gradient(points), axis=1)
    off = np.abs(surface.value(points)) / np.maximum(size, 1e-9)
    assert np.median(off) < 0.02 * THREE.frame.length


def test_the_arrow_is_the_lost_translation_in_the_scene():
    arrow = next(marker for marker in ALL["camera losing a motion"] if marker.type == Marker.ARROW)
    tail, tip = arrow.points
    assert (tip.x - tail.x, tip.y - tail.y) == (0.0, 0.0) and tip.z > tail.z


def test_the_path_keeps_the_color_of_each_pose():
    camera = CameraMarkers(PAPER)
    for level in (Level.OK, Level.WARN, Level.CRITICAL):
        markers = camera.markers(Pose(np.eye(3), np.array([float(level), 0, 0])), level, "x", None, HEAD).markers
    path = next(marker for marker in markers if marker.ns == "camera_path")
    assert len({(each.r, each.g, each.b) for each in path.colors}) == 3


def test_the_viewers_files_name_our_topics():
    rviz = yaml.safe_load(config_file("rviz/singularity.rviz").read_text())
    topics = [each["Topic"]["Value"] for each in rviz["Visualization Manager"]["Displays"] if "Topic" in each]
    assert topics == ["/singularity_markers", "/camera_markers", "/controller/planned_path"]
    assert rviz["Visualization Manager"]["Global Options"]["Fixed Frame"] == "world"
    foxglove = json.loads(config_file("foxglove/singularity.json").read_text())
    assert set(foxglove["configById"]["3D!loci"]["topics"]) == set(topics)

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert set(leaves(foxglove["layout"])) == set(foxglove["configById"])
