# SPDX-License-Identifier: Apache-2.0
"""Images of an object with flat faces, drawn by OpenCV: no graphics card or library is needed."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import numpy.typing as npt

from plsing_ros.arrays import Array
from plsing_ros.errors import PlsingError
from plsing_ros.geometry import Pose
from plsing_ros.geometry.model import Model
from plsing_ros.tracking.camera import PinholeCamera

_OVERSAMPLING = 4
_SHIFT = 6  # bits of a pixel's fraction that OpenCV draws with
_PIECES = 8  # of a border, which a lens may bend


@dataclass(frozen=True, eq=False)
class Patch:
    """A flat polygon that is painted on a face.

    Attributes:
        face: Row of the model's faces.
        outline: Shape (k, 3), in the model frame [m].
        light: That it reflects, in [0, 1].
    """

    face: int
    outline: Array
    light: float


class PolygonRenderer:
    """Draws an object before an even background.

    Faces are drawn from far to near, by their middles: right for convex objects and for such as stand apart. Light is
    averaged over each pixel and then turned into grey levels, as in a camera.

    Args:
        model: The object.
        camera: The camera.
        lights: That each face reflects, in [0, 1].
        background: Light from behind, in [0, 1].
        patches: Painted on the faces.
        gamma: Exponent from grey levels to light.
    """

    def __init__(
        self,
        model: Model,
        camera: PinholeCamera,
        lights: Sequence[float],
        background: float = 0.1,
        patches: Sequence[Patch] = (),
        gamma: float = 2.2,
    ) -> None:
        self._cv = load_opencv()
        self._model = model
        self._camera = camera
        self._lights = tuple(lights)
        self._background = background
        self._patches = tuple(patches)
        self._gamma = gamma

    def render(
        self, T_camera_model: Pose, noise: float = 0.0, random: np.random.Generator | None = None
    ) -> npt.NDArray[np.uint8]:
        """Return the image, shape (height, width).

        Args:
            T_camera_model: Where the object is; faces that reach behind the camera are left out.
            noise: Standard deviation of what is added [grey levels].
            random: Where the noise comes from; needed if there is any.
        """
        camera = self._camera
        size = camera.height * _OVERSAMPLING, camera.width * _OVERSAMPLING
        canvas = np.full(size, round(255 * self._background), dtype=np.uint8)
        corners = self._model.vertices @ T_camera_model.rotation.T + T_camera_model.translation
        depths = [float(np.linalg.norm(corners[list(face)].mean(axis=0))) for face in self._model.faces]
        for row in np.argsort(depths)[::-1].tolist():
            face = list(self._model.faces[row])
            self._fill(canvas, corners[face], self._lights[row])
            if self._is_in_front(corners, row):
                for patch in self._patches:
                    if patch.face == row:
                        outline = patch.outline @ T_camera_model.rotation.T + T_camera_model.translation
                        self._fill(canvas, outline, patch.light)
        light = self._cv.resize(canvas.astype(np.float32), (camera.width, camera.height), interpolation=3)  # by area
        grey = 255.0 * (light / 255.0) ** (1.0 / self._gamma)
        if noise > 0.0 and random is not None:
            grey = grey + random.normal(0.0, noise, grey.shape)
        image: npt.NDArray[np.uint8] = np.clip(np.round(grey), 0, 255).astype(np.uint8)
        return image

    def _is_in_front(self, corners: Array, row: int) -> bool:
        face = self._model.faces[row]
        a, b, c = (corners[face[i]] for i in range(3))
        outwards = np.cross(b - a, c - a) @ (a - corners.mean(axis=0))
        # A plate has no outside: both its sides are painted.
        return bool(np.cross(b - a, c - a) @ a * outwards <= 1e-15)

    def _fill(self, canvas: npt.NDArray[np.uint8], outline: Array, light: float) -> None:
        if outline[:, 2].min() <= 1e-6:
            return
        shares = np.arange(_PIECES)[:, np.newaxis] / _PIECES
        following = np.roll(outline, -1, axis=0)
        bent = np.concatenate([a + shares * (b - a) for a, b in zip(outline, following, strict=True)])
        pixels = (self._camera.project(bent) + 0.5) * _OVERSAMPLING - 0.5
        if np.abs(pixels).max() < 1e5:
            points = np.round(_shrunk(pixels) * 2**_SHIFT).astype(np.int32)
            self._cv.fillPoly(canvas, [points], round(255 * light), shift=_SHIFT)


def load_opencv() -> ModuleType:
    """Return OpenCV.

    Raises:
        PlsingError: If it is not installed.
    """
    try:
        return importlib.import_module("cv2")
    except ImportError:
        raise PlsingError(
            "images are drawn with OpenCV, which is not installed: sudo apt install python3-opencv, or pip install "
            "opencv-python-headless"
        ) from None


def _shrunk(outline: Array) -> Array:
    """Return a polygon half a pixel smaller all round: OpenCV fills every pixel that the border touches."""
    along = np.roll(outline, -1, axis=0) - outline
    x, y = outline.T
    area = float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    inwards = np.column_stack([-along[:, 1], along[:, 0]]) * np.sign(area)
    inwards /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    before = np.roll(inwards, 1, axis=0)
    stretch = np.maximum(1.0 + np.einsum("ij,ij->i", before, inwards), 0.2)
    shrunk: Array = outline + 0.5 * (before + inwards) / stretch[:, np.newaxis]
    return shrunk


def random_patches(model: Model, count: int, random: np.random.Generator) -> list[Patch]:
    """Return patches with random places, sizes and lights on the faces of a model, as texture.

    Args:
        model: Only its faces of four corners are painted.
        count: Of patches on each face.
        random: Where they come from.
    """
    patches = []
    for row, face in enumerate(model.faces):
        if len(face) != 4:
            continue
        origin, right, _, down = (model.vertices[i] for i in face)
        for _ in range(count):
            x, y = random.uniform(0.05, 0.8, 2)
            w, h = random.uniform(0.05, 0.15, 2)
            corners = np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])
            outline = origin + corners[:, :1] * (right - origin) + corners[:, 1:] * (down - origin)
            patches.append(Patch(row, outline, float(random.uniform(0.05, 0.9))))
    return patches
