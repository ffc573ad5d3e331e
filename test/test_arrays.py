# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from plsing_ros.arrays import checked_array


def test_what_may_still_be_written_to_is_copied():
    mine = np.arange(3.0)
    view = mine[:]
    view.setflags(write=False)
    for given in (mine, view):
        taken = checked_array("it", given, (3,))
        mine[0] = 7.0
        assert taken[0] == 0.0
        assert not taken.flags.writeable
        mine[0] = 0.0


@pytest.mark.parametrize("value", [[1, 2, 3], np.ones(3, dtype=np.float32), np.ones(6)[::2], np.ones(3, dtype=">f8")])
def test_all_become_rows_of_float64_that_are_not_copied_again(value):
    taken = checked_array("it", value, (3,))
    assert taken.dtype == np.float64 and taken.dtype.isnative and taken.flags.c_contiguous
    assert checked_array("it", taken, (3,)) is taken
