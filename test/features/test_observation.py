"""Observations made of rows that do not fit together."""

import numpy as np
import pytest

from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"visible": [True, False, True]}, "visible has 3 values for 2 ids"),
        ({"visible": [True]}, r"usable has shape \(1,\), expected \(2,\)"),
        ({"directions": [[1, 0, 0]]}, r"directions has shape \(1, 3\), expected \(2, 3\)"),
        ({"moments": [[0, 1, 0]]}, r"moments has shape \(1, 3\), expected \(2, 3\)"),
        ({"image_lines": [[0, 1, 0]]}, r"image_lines has shape \(1, 3\), expected \(2, 3\)"),
    ],
)
@pytest.mark.parametrize("seen", [[True, True], [True, False]])
def test_rows_of_other_lengths_are_refused(given, message, seen):
    rows = {"image_lines": [[0, 1, 0]] * 2, "directions": [[1, 0, 0]] * 2, "moments": [[0, 1, 0]] * 2, "visible": seen}
    arrays = {name: np.array(values) for name, values in (rows | given).items()}
    with pytest.raises(ObservationError, match=message):
        LineObservation.from_rows((1, 2), frame="camera", **arrays)
