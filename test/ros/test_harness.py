# SPDX-License-Identifier: Apache-2.0
"""The harness itself: isolation, determinism, and what it says when something does not come."""

import pytest
from messages import mentions
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from plsing_ros.testing.harness import Harness, HarnessTimeoutError


def test_two_harnesses_do_not_hear_each_other(ros):
    with Harness() as other:
        assert other.domain != ros.domain
        here, there = ros.collect(String, "talk"), other.collect(String, "talk")
        talk = ros.publisher(String, "talk")
        talk.publish(String(data="psst"))
        ros.spin_until(lambda: here, "our own message")
        other.spin_for(0.3)
        assert [each.data for each in here] == ["psst"]
        assert there == []


def test_a_timeout_says_what_was_received(ros):
    collected = ros.collect(String, "talk")
    ros.collect(String, "silent")
    ros.publisher(String, "talk").publish(String(data="something else"))
    with pytest.raises(HarnessTimeoutError) as caught:
        ros.spin_until(lambda: len(collected) == 2, "two messages", timeout=0.5)
    text = str(caught.value)
    assert mentions(text, "0.5 s", "two messages")
    assert mentions(text, "talk: 1 message", "std_msgs.msg.String(data='something else')")
    assert "silent: nothing" in text


def test_nothing_runs_between_two_calls(ros):
    collected = ros.collect(String, "talk")
    talk = ros.publisher(String, "talk")
    for word in "abc":
        talk.publish(String(data=word))
    assert collected == []
    ros.spin_until(lambda: len(collected) == 3, "three messages")
    assert [each.data for each in collected] == ["a", "b", "c"]


def test_services_are_called_and_removed_nodes_are_gone(ros):
    class Server(Node):
        def __init__(self, **options):
            super().__init__("server", **options)
            self.create_service(Trigger, "~/act", self.act)

        def act(self, _, response):
            response.message = "done"
            return response

    server = ros.add(Server)
    assert ros.call(Trigger, "server/act", Trigger.Request()).message == "done"
    ros.remove(server)
    with pytest.raises(HarnessTimeoutError, match="service server/act"):
        ros.call(Trigger, "server/act", Trigger.Request(), timeout=0.5)


def test_an_exception_in_a_callback_reaches_the_test(ros):
    class Faulty(Node):
        def __init__(self, **options):
            super().__init__("faulty", **options)
            self.create_subscription(String, "talk", self.fail, 10)

        def fail(self, message):
            raise ZeroDivisionError(message.data)

    ros.add(Faulty)
    ros.publisher(String, "talk").publish(String(data="boom"))
    with pytest.raises(ZeroDivisionError, match="boom"):
        ros.spin_for(2.0)
