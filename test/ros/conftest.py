# SPDX-License-Identifier: Apache-2.0
import sys
import types

import pytest

from plsing_ros.nodes import qos
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


@pytest.fixture
def tf2_ros(monkeypatch):
    """In the place of tf2_ros, of which there is no wheel: its calls, for frames that one transform joins.

    docs/results/ros.md tells how the real one was tried.
    """
    from tf2_msgs.msg import TFMessage

    class TransformException(Exception):  # noqa: N818
        pass

    class Buffer:
        def __init__(self):
            self.known = {}

        def lookup_transform(self, target_frame, source_frame, time):
            assert time.nanoseconds == 0  # the latest
            if (target_frame, source_frame) not in self.known:
                raise TransformException(f'"{target_frame}" passed to lookupTransform does not exist.')
            return self.known[target_frame, source_frame]

    class TransformListener:
        def __init__(self, buffer, node):
            for topic, profile in (("/tf", qos.TRANSFORMS), ("/tf_static", qos.LATCHED)):
                node.create_subscription(TFMessage, topic, lambda message: self.receive(buffer, message), profile)

        def receive(self, buffer, message):
            for each in message.transforms:
                buffer.known[each.header.frame_id, each.child_frame_id] = each

    module = types.ModuleType("tf2_ros")
    module.TransformException, module.Buffer, module.TransformListener = TransformException, Buffer, TransformListener
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
