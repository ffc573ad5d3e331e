# SPDX-License-Identifier: Apache-2.0
"""Images of an object on a table, and of the arm before it, drawn by MuJoCo: an optional dependency, as is OpenCV."""

from __future__ import annotations

import importlib
import os
from collections.abc import Sequence
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array, cross
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.simulation.arm import AXES, CAMERA_OFFSET, JOINTS, OFFSETS, Arm
from plsing_ros.simulation.polygon_renderer import Patch, load_opencv
from plsing_ros.tracking.camera import PinholeCamera

_TEXTURE = 512  # pixels of a face's texture along its longer side
_RADII = (0.06, 0.055, 0.045, 0.04, 0.035, 0.03)
_NEAR, _FAR = 0.01, 20.0  # [m]


class MujocoRenderer:
    """Draws what the wrist camera sees, and the arm from outside.

    Args:
        model: The object.
        camera: Without distortion.
        arm: The arm.
        lights: That each face reflects, in [0, 1].
        patches: Painted on the faces.
        background: That the table reflects, in [0, 1].
        samples: Of each pixel, against stairs along edges.

    Raises:
        PlsingError: If MuJoCo or what it draws with is not installed; the message says what to install.
    """

    def __init__(
        self,
        model: Model,
        camera: PinholeCamera,
        arm: Arm,
        lights: Sequence[float],
        patches: Sequence[Patch] = (),
        background: float = 0.25,
        samples: int = 4,
    ) -> None:
        self._mujoco = _load()
        files: dict[str, bytes] = {}
        text = _scene(model, camera, arm, lights, patches, background, samples, files)
        self._scene = self._mujoco.MjModel.from_xml_string(text, files)
        self._data = self._mujoco.MjData(self._scene)
        try:
            self._views = {
                "wrist": self._mujoco.Renderer(self._scene, camera.height, camera.width),
                "outside": self._mujoco.Renderer(self._scene, 480, 640),
            }
        except Exception as error:
            raise PlsingError(f"MuJoCo cannot draw here: {error}; {_ADVICE}") from None

    def render(self, joints: Array, view: str = "wrist", shadows: bool = False) -> npt.NDArray[np.uint8]:
        """Return a picture in red, green and blue, shape (height, width, 3); its values are proportional to light.

        Args:
            joints: Of the arm, shape (6,) [rad].
            view: wrist, or outside for a look at the arm.
            shadows: Whether the lamp casts shadows, which takes several times as long.
        """
        self._data.qpos[:] = joints
        self._mujoco.mj_forward(self._scene, self._data)
        renderer = self._views[view]
        renderer.update_scene(self._data, view)
        renderer.scene.flags[self._mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        picture: npt.NDArray[np.uint8] = renderer.render()
        return picture

    def site_pose(self, joints: Array) -> tuple[Array, Array]:
        """Return where MuJoCo has the camera and its Jacobian in the world's axes, shapes (4, 4) and (6, 6)."""
        self._data.qpos[:] = joints
        self._mujoco.mj_forward(self._scene, self._data)
        pose, jacobian = np.eye(4), np.zeros((6, 6))
        pose[:3, 3] = self._data.site("camera").xpos
        pose[:3, :3] = self._data.site("camera").xmat.reshape(3, 3)
        self._mujoco.mj_jacSite(self._scene, self._data, jacobian[:3], jacobian[3:], self._scene.site("camera").id)
        return pose, jacobian

    def close(self) -> None:
        """Give back what the pictures are drawn in."""
        for renderer in self._views.values():
            renderer.close()


_ADVICE = "without a graphics card it needs libosmesa6: sudo apt install libosmesa6"


def _load() -> ModuleType:
    """Return MuJoCo, which chooses what it draws with when it is imported for the first time."""
    if importlib.util.find_spec("mujoco") is None:
        raise PlsingError("MuJoCo is not installed: pip install 'mujoco>=3.1,<3.4'")
    os.environ.setdefault("MUJOCO_GL", "osmesa")
    try:
        return importlib.import_module("mujoco")
    except Exception as error:
        # Without its library, PyOpenGL fails with an AttributeError of its own.
        raise PlsingError(f"MuJoCo cannot draw here: {error}; {_ADVICE}") from None


def _scene(
    model: Model,
    camera: PinholeCamera,
    arm: Arm,
    lights: Sequence[float],
    patches: Sequence[Patch],
    background: float,
    samples: int,
    files: dict[str, bytes],
) -> str:
    assets, geoms = [], []
    for number, face in enumerate(model.faces):
        corners = model.vertices[list(face)]
        name = f"face_{number}"
        picture, at_corners = _texture(corners, lights[number], [each for each in patches if each.face == number])
        files[f"{name}.png"] = _png(picture)
        triangles = [tuple(face.index(row) for row in t) for t in _triangles(model, face)]
        # Each from both sides: what is turned away is not drawn, and the light falls on the right one.
        vertices = np.vstack([corners, corners])
        rows = [*triangles, *(tuple(i + len(face) for i in t[::-1]) for t in triangles)]
        places = np.vstack([at_corners, at_corners])
        assets.append(
            f'<mesh name="{name}" inertia="shell" vertex="{_numbers(vertices)}" face="{_numbers(rows)}" '
            f'texcoord="{_numbers(places)}"/>'
            f'<texture name="{name}" type="2d" file="{name}.png"/>'
            f'<material name="{name}" texture="{name}" specular="0" shininess="0"/>'
        )
        geoms.append(f'<geom type="mesh" mesh="{name}" material="{name}" contype="0" conaffinity="0"/>')
    floor = float(model.vertices[:, 2].min()) - 1e-4
    center = model.center
    body, closing = "", ""
    for name, offset, axis, radius in zip(JOINTS, OFFSETS, AXES, _RADII, strict=True):
        body += (
            f'<geom type="capsule" fromto="0 0 0 {_numbers(offset)}" size="{radius}" rgba=".75 .77 .8 1" '
            'mass="1" contype="0" conaffinity="0"/>'
            f'<body pos="{_numbers(offset)}"><joint name="{name}" axis="{_numbers(axis)}"/>'
            f'<geom type="sphere" size="{1.1 * radius}" rgba=".1 .35 .6 1" mass="1" contype="0" conaffinity="0"/>'
        )
        closing += "</body>"
    fx, fy = camera.fx, camera.fy
    # OpenGL counts from the corner of the image, and its y axis points up.
    cx, cy = camera.cx + 0.5 - 0.5 * camera.width, camera.cy + 0.5 - 0.5 * camera.height
    x, y, z, w = arm.T_world_base.quaternion_xyzw.tolist()
    eye = center + np.array([0.9, -1.3, 0.8])
    outside = Pose.look_at(eye, 0.5 * (center + arm.T_world_base.translation) + [0, 0, 0.2]).rotation
    return f"""<mujoco>
<visual><global offwidth="{max(camera.width, 640)}" offheight="{max(camera.height, 480)}"/>
<quality offsamples="{samples}" shadowsize="2048"/><map znear="{_NEAR}" zfar="{_FAR}"/>
<headlight ambient=".45 .45 .45" diffuse="0 0 0" specular="0 0 0"/></visual>
<statistic extent="1" center="{_numbers(center)}"/>
<asset>{"".join(assets)}</asset>
<worldbody>
<light directional="true" pos="{_numbers(center + [0.3, -0.4, 1.5])}" dir="-.3 .4 -1.2" diffuse=".55 .55 .55"
 specular="0 0 0" ambient="0 0 0"/>
<geom type="plane" pos="0 0 {floor}" size="3 3 .1" rgba="{background} {background} {background} 1"/>
{"".join(geoms)}
<body pos="{_numbers(arm.T_world_base.translation)}" quat="{w} {x} {y} {z}">{body}
<site name="camera" pos="{_numbers(CAMERA_OFFSET)}"/>
<geom type="cylinder" fromto="0 0 0 0 0 .02" size=".03" rgba=".2 .2 .2 1" mass="1" contype="0" conaffinity="0"/>
<camera name="wrist" pos="{_numbers(CAMERA_OFFSET)}" xyaxes="1 0 0 0 -1 0" resolution="{camera.width} {camera.height}"
 sensorsize="{1e-5 * camera.width} {1e-5 * camera.height}" focalpixel="{fx} {fy}" principalpixel="{-cx} {cy}"/>
{closing}</body>
<camera name="outside" pos="{_numbers(eye)}" fovy="45" xyaxes="{_numbers(outside[:, 0])} {_numbers(-outside[:, 1])}"/>
</worldbody></mujoco>"""


def _triangles(model: Model, face: tuple[int, ...]) -> list[tuple[int, ...]]:
    """Return the triangles of the model that a face was cut into."""
    return [t for t in map(tuple, model.triangles.tolist()) if set(t) <= set(face)]


def _texture(corners: Array, light: float, patches: Sequence[Patch]) -> tuple[npt.NDArray[np.uint8], Array]:
    """Return the picture on a face, and where its corners are in it, shape (k, 2), from 0 to 1."""
    cv = load_opencv()
    right = corners[1] - corners[0]
    right = right / np.linalg.norm(right)
    normal = next(n for c in corners[2:] if np.linalg.norm(n := cross(right, c - corners[0])) > 1e-9)
    down = cross(normal / np.linalg.norm(normal), right)
    axes = np.column_stack([right, down])
    flat = corners @ axes
    low, size = flat.min(axis=0), float(np.ptp(flat, axis=0).max())
    picture = np.full((_TEXTURE, _TEXTURE), round(255 * light), dtype=np.uint8)
    for patch in patches:
        outline = (patch.outline @ axes - low) / size * _TEXTURE - 0.5
        cv.fillPoly(picture, [np.round(outline * 16).astype(np.int32)], round(255 * patch.light), cv.LINE_AA, 4)
    return picture, (flat - low) / size


def _png(picture: npt.NDArray[np.uint8]) -> bytes:
    done, data = load_opencv().imencode(".png", picture)
    if not done:
        raise PlsingError("OpenCV cannot write a picture in the format PNG")
    content: bytes = data.tobytes()
    return content


def _numbers(values: Any) -> str:
    return " ".join(f"{each:.9g}" for each in np.ravel(values))
