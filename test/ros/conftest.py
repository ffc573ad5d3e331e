# SPDX-License-Identifier: Apache-2.0
import pytest

from plsing_ros.parameters.config_files import config_file
from plsing_ros.testing.harness import Harness


@pytest.fixture(params=["events", "single"])
def ros(request):
    """A harness for one test, once for each executor that a user can choose."""
    with Harness(request.param) as harness:
        yield harness


@pytest.fixture
def paper():
    """The parameter file of the paper's four lines."""
    return config_file("paper_p4l.yaml")
