# SPDX-License-Identifier: Apache-2.0
"""What draws the images: MuJoCo beside OpenCV, and a sentence where MuJoCo cannot; the loop that is closed on them."""

import importlib.util
import sys
from dataclasses import replace

import numpy as np
import pytest
from messages import mentions

from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.parameters import ControllerParameters
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.simulation import mujoco_renderer
from plsing_ros.simulation.arm import Arm
from plsing_ros.simulation.arm_simulation import ArmSimulation
from plsing_ros.simulation.camera_loop import CameraLoop
from plsing_ros.simulation.mujoco_renderer import MujocoRenderer
from plsing_ros.simulation.polygon_renderer import Patch, PolygonRenderer
from plsing_ros.tracking import PinholeCamera

pytest.importorskip("cv2")
SCENE = config_file("camera_arm.yaml")
ARM = Arm(Pose(np.eye(3), [-0.45, 0.0, -0.035]))


def why_not_drawn():
    """Why MuJoCo, an extra, cannot draw on this machine; empty where it can."""
    try:
        MujocoRenderer(plate(), PinholeCamera(64, 48, 60, 60, 31.5, 23.5), ARM, [0.5]).close()
    except PlsingError as error:
        return str(error)
    return ""


def arm_parameters(**values):
    return ArmSimulatorParameters.from_values({**read_parameters(SCENE, "arm_simulator"), "mode": "lockstep", **values})


def plate():
    corners = [[-0.1, -0.07, 0], [0.1, -0.07, 0], [0.1, 0.07, 0], [-0.1, 0.07, 0]]
    return Model.from_faces(corners, [(0, 1, 2, 3)])


WHY_NOT = why_not_drawn()
needs_mujoco = pytest.mark.skipif(bool(WHY_NOT), reason=WHY_NOT)


@needs_mujoco
def test_mujoco_has_the_camera_at_the_same_place_with_the_same_jacobian():
    renderer = MujocoRenderer(plate(), PinholeCamera(64, 48, 60, 60, 31.5, 23.5), ARM, [0.5])
    for at in ([0.3, 0.4, 1.5, -0.6, 0.9, 0.5], [-0.2, -0.5, -1.0, 2.0, -0.4, 1.0], np.zeros(6)):
        pose, jacobian = renderer.site_pose(np.array(at))
        ours = ARM.camera_pose(at)
        np.testing.assert_allclose(pose[:3, 3], ours.translation, atol=1e-12)
        np.testing.assert_allclose(pose[:3, :3], ours.rotation, atol=1e-12)
        turned = np.kron(np.eye(2), ours.rotation) @ ARM.jacobian(np.array(at))
        np.testing.assert_allclose(jacobian, turned, atol=1e-12)
    renderer.close()


@needs_mujoco
def test_both_draw_a_bright_patch_where_the_camera_has_it():
    """Its centre of brightness, off the middle of the image and with an odd principal point, to a tenth of a pixel."""
    camera = PinholeCamera(640, 480, 600.0, 605.0, 322.3, 236.8)
    center = np.array([0.05, -0.03, 0.0])
    square = center + 0.004 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    patch = Patch(0, square, 1.0)
    joints = ARM.joints_for(Pose.look_at((-0.05, -0.02, 0.35), (0.0, 0.0, 0.0)))
    pose = ARM.camera_pose(joints)
    expected = camera.project((center - pose.translation)[np.newaxis] @ pose.rotation)[0]
    with_mujoco = MujocoRenderer(plate(), camera, ARM, [0.0], [patch], background=0.0, samples=8)
    pictures = [
        with_mujoco.render(joints)[..., 1],
        PolygonRenderer(plate(), camera, [0.0], 0.0, [patch], gamma=1.0).render(pose.inverse()),
    ]
    with_mujoco.close()
    for picture in pictures:
        rows, columns = np.indices(picture.shape)
        light = picture.astype(float)
        found = np.array([(light * columns).sum(), (light * rows).sum()]) / light.sum()
        np.testing.assert_allclose(found, expected, atol=0.1)


@pytest.mark.parametrize(
    ("found", "said"),
    [
        (None, "pip install 'mujoco"),
        (importlib.util.find_spec("json"), "sudo apt install libosmesa6"),
    ],
    ids=["no MuJoCo", "no library to draw with"],
)
def test_where_mujoco_cannot_draw_opencv_does_and_says_what_to_install(monkeypatch, found, said):
    monkeypatch.setattr(mujoco_renderer.importlib.util, "find_spec", lambda name: found)
    # What is found cannot be imported, as with PyOpenGL without OSMesa.
    monkeypatch.setitem(sys.modules, "mujoco", None)
    simulation = ArmSimulation(arm_parameters())
    assert mentions(simulation.renderer, said, "OpenCV")
    assert simulation.image.shape == (480, 640) and np.ptp(simulation.image) > 50
    assert simulation.look_at(simulation.joints) is None
    with pytest.raises(PlsingError, match="MuJoCo"):
        ArmSimulation(arm_parameters(renderer="mujoco"))


def test_without_opencv_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(PlsingError, match="python3-opencv"):
        ArmSimulation(arm_parameters(renderer="polygons"))


def test_the_camera_moves_as_the_twist_says_and_the_image_with_it():
    simulation = ArmSimulation(arm_parameters(renderer="polygons", time_step=0.02))
    before, start = simulation.image, simulation.T_world_camera
    twist = np.array([0.05, -0.03, 0.04, 0.1, -0.2, 0.1])
    for _ in range(5):
        simulation.receive_twist(twist, simulation.stamp)
        assert simulation.step_in_lockstep()
    expected = start.integrate(twist, 0.1)
    assert simulation.T_world_camera.is_close(expected, 1e-5)
    assert (simulation.image != before).any() and simulation.remark == ""
    simulation.reset()
    assert simulation.T_world_camera.is_close(start, 1e-9) and simulation.step == 0


def test_light_and_noise_change_while_it_runs():
    parameters = arm_parameters(renderer="polygons", **{"image.noise": 0.0})
    simulation = ArmSimulation(parameters)
    bright = simulation.image.astype(int)
    simulation.prepare(replace(parameters, light=0.25))()
    simulation.look()
    ratio = simulation.image[bright > 100] / bright[bright > 100]
    assert np.median(ratio) == pytest.approx(0.25 ** (1 / 2.2), abs=0.02)
    simulation.prepare(replace(parameters, image_noise=5.0))()
    simulation.look()
    assert np.std(simulation.image.astype(int) - bright) == pytest.approx(5.0, rel=0.05)


@pytest.mark.slow
@pytest.mark.parametrize(("law", "from_pose", "renderer"), [("position", True, "auto"), ("pinv", False, "polygons")])
def test_the_loop_closed_on_images_arrives(law, from_pose, renderer):
    controller = ControllerParameters.from_values({**read_parameters(SCENE, "controller"), "law": law, "gain": 2.0})
    loop = CameraLoop(arm_parameters(renderer=renderer, **{"camera.focal_length": 600.0}), controller, from_pose)
    target, start = controller.target_pose(), loop.simulation.T_world_camera
    assert np.linalg.norm(start.translation - target.translation) == pytest.approx(0.15, abs=1e-3)
    for number, frame in enumerate(loop.frames(start)):
        assert frame.report.usable, frame.report.reason
        if number == 120:
            break
    off = target.inverse() @ frame.T_world_camera
    assert np.linalg.norm(off.translation) < (5e-4 if from_pose else 2e-3)
    assert np.degrees(np.arccos(np.clip(0.5 * (np.trace(off.rotation) - 1.0), -1, 1))) < 0.2
