"""Markers against what RViz and Foxglove need: frames, scales, colours, orientations, points, lifetimes."""

import json

import numpy as np
import pytest
import yaml
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
    names = {marker.ns: marker for marker in ALL["four lines"]}
    assert ALL["four lines"][0].action == Marker.DELETEALL  # nothing of an earlier scene stays
    assert len(names["transversals"].points) == 4 and len(names["isolated_points"].points) == 6
    assert [marker.ns for marker in ALL["three lines"]].count("surfaces") == 2
    assert {marker.ns for marker in ALL["corridor"]} == {"", "observed_lines"}


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
    assert topics == ["/singularity_markers", "/camera_markers"]
    assert rviz["Visualization Manager"]["Global Options"]["Fixed Frame"] == "world"
    foxglove = json.loads(config_file("foxglove/singularity.json").read_text())
    assert set(foxglove["configById"]["3D!loci"]["topics"]) == set(topics)

    def leaves(node):
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert set(leaves(foxglove["layout"])) == set(foxglove["configById"])
