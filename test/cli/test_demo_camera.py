# SPDX-License-Identifier: Apache-2.0
"""The camera demo: all nodes as processes over real topics, and what it says when the arm does not arrive."""

import matplotlib.image
import numpy as np
import pytest
from messages import mentions

from plsing_ros.cli import demo_camera
from plsing_ros.geometry import Pose
from plsing_ros.levels import Level
from plsing_ros.simulation.camera_record import CameraRecord, Picture
from plsing_ros.simulation.camera_scene import camera_scenes
from plsing_ros.simulation.run_record import Alert
from plsing_ros.singularities import singular_set

pytest.importorskip("cv2")


@pytest.mark.slow
def test_the_arm_arrives_by_images_and_leaves_pictures(tmp_path, capfd):
    code = demo_camera.main(["--runs", "approach", "--output", str(tmp_path / "new")])
    output = capfd.readouterr().out
    assert code == 0, output
    assert mentions(output, "approach", "arrived")
    files = sorted((tmp_path / "new").glob("*.png"))
    assert [file.stem for file in files] == ["approach", "risk_and_alerts", "trajectories"]
    for file in files:
        assert str(file) in output
        assert matplotlib.image.imread(file)[..., :3].std() > 0.05  # not an empty page


def test_an_arm_that_does_not_arrive_is_a_sentence_and_exit_code_1(tmp_path, capfd, monkeypatch):
    def stuck(scene, on_alert, on_distance):
        record = CameraRecord(scene)
        for k in range(10):
            on_distance(*record.add(10**9 + k * 10**8, Pose(scene.start.rotation, scene.start.translation)))
        record.pictures.append(Picture(0.1, np.zeros((480, 640, 3), np.uint8), np.zeros(6)))
        record.twists += [(0.2, np.zeros(6)), (0.1, np.ones(6))]
        record.statuses.append((0.3, 0.01, float("nan")))
        record.alerts.append(Alert(0.2, Level.WARN, "WARN: near"))
        on_alert(record.alerts[0])
        record.last_words["line_tracker"] = "LOST the image is black"
        return record

    monkeypatch.setattr(demo_camera, "run_camera_scene", stuck)
    assert demo_camera.main(["--output", str(tmp_path)]) == 1
    out, err = capfd.readouterr()
    assert mentions(out, "line_tracker: LOST", "WARN: near")
    # The plain law need not arrive.
    assert mentions(err, "demo_camera", "approach", "crossing_fused")


def test_the_crossing_leads_across_a_transversal_of_the_edges_that_the_plain_law_uses():
    plain, fused = camera_scenes()[1:]
    assert plain.start is fused.start and plain.target is fused.target
    start, target = plain.start.translation, plain.target.translation
    points, directions = singular_set(plain.lines()).transversal_lines
    middle = 0.5 * (start + target)
    distances = np.linalg.norm(np.cross(middle - points, directions), axis=1) / np.linalg.norm(directions, axis=1)
    assert distances.min() < 1e-3 < 0.05 < np.linalg.norm(target - start)
