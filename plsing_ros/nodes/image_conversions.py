# SPDX-License-Identifier: Apache-2.0
"""Between messages about cameras and the core's values."""

from __future__ import annotations

import array

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header

from plsing_ros.errors import ObservationError
from plsing_ros.tracking import PinholeCamera

# Channels of each encoding, and their weights in 1/256 for brightness (ITU-R BT.601).
_ENCODINGS = {"mono8": (256,), "bgr8": (29, 150, 77), "rgb8": (77, 150, 29)}


def grey_from_message(message: Image) -> npt.NDArray[np.uint8]:
    """Return a grey image, shape (height, width).

    Raises:
        ObservationError: If the encoding is not known, or the data are not as long as the size and the step say.
    """
    weights = _ENCODINGS.get(message.encoding)
    if weights is None:
        raise ObservationError(f"the image's encoding is '{message.encoding}'; known are {', '.join(_ENCODINGS)}")
    height, width, step, channels = message.height, message.width, message.step, len(weights)
    data = np.frombuffer(message.data, np.uint8)
    if height == 0 or width == 0 or step < width * channels or len(data) != height * step:
        raise ObservationError(
            f"the image has {len(data)} bytes for {height} rows of {step}, and {width} pixels of {channels} byte(s) "
            "each; its data are cut off or its size is wrong"
        )
    rows = data.reshape(height, step)[:, : width * channels]
    if channels == 1:
        return np.ascontiguousarray(rows)
    parts = rows.reshape(height, width, channels)
    grey: npt.NDArray[np.uint8] = (
        (parts[..., 0] * np.uint16(weights[0]) + parts[..., 1] * np.uint16(weights[1]))
        + parts[..., 2] * np.uint16(weights[2])
        >> 8
    ).astype(np.uint8)
    return grey


def image_message(image: npt.NDArray[np.uint8], head: Header) -> Image:
    """Return the message of a grey or a blue-green-red image, shape (height, width) or (height, width, 3)."""
    height, width = image.shape[:2]
    encoding = "mono8" if image.ndim == 2 else "bgr8"
    message = Image(header=head, height=height, width=width, encoding=encoding, step=image.strides[0])
    # Bytes in an array: any other sequence is checked number by number, which takes 57 ms.
    message.data = array.array("B", np.ascontiguousarray(image).tobytes())
    return message


def camera_info_message(camera: PinholeCamera, head: Header) -> CameraInfo:
    """Return the message of a calibration; R is the identity and P has no baseline, as of a single camera."""
    coefficients = list(camera.distortion)
    k = [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]
    return CameraInfo(
        header=head,
        width=camera.width,
        height=camera.height,
        distortion_model="plumb_bob" if len(coefficients) <= 5 else "rational_polynomial",
        d=coefficients + [0.0] * ((5 if len(coefficients) <= 5 else 8) - len(coefficients)),
        k=k,
        r=[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p=[*k[:3], 0.0, *k[3:6], 0.0, *k[6:], 0.0],
    )


def camera_from_message(message: CameraInfo) -> PinholeCamera:
    """Return the camera of a calibration.

    Raises:
        GeometryError: If it is not calibrated, or its distortion model is not known.
    """
    return PinholeCamera.from_calibration(
        message.width, message.height, message.k.tolist(), message.distortion_model, list(message.d)
    )
