# SPDX-License-Identifier: Apache-2.0
"""The messages' definitions: constants against the core's enumerations, and a frame for every position."""

import importlib

import pytest

import plsing_msgs.msg
import plsing_msgs.srv
from plsing_msgs.msg import (
    ControllerState,
    LineFeatureArray,
    LocusDistance,
    PoseEstimate,
    SimulatorState,
    SingularityAlert,
    SingularityStatus,
)
from plsing_msgs.srv import CheckTarget
from plsing_ros.control.command import Mode
from plsing_ros.features import LinesVerdict
from plsing_ros.levels import Level
from plsing_ros.monitoring.approach import Trend
from plsing_ros.planning.detour import Decision
from plsing_ros.planning.rollout import Harm
from plsing_ros.pose import Verdict
from plsing_ros.singularities import Kind

SERVICES = [part for name in ("CheckPose", "CheckTarget") for part in (f"{name}_Request", f"{name}_Response")]


def constants(message, prefix):
    """The constants of a message by name without the prefix; rosidl makes properties of its metaclass of them."""
    listed = type(message).__dict__[f"_{type(message).__name__}__constants"]
    return {name.removeprefix(prefix): getattr(message, name) for name in listed if name.startswith(prefix)}


@pytest.mark.parametrize(
    ("message", "prefix", "values"),
    [
        (SingularityStatus, "LEVEL_", Level),
        (SingularityAlert, "LEVEL_", Level),
        (SingularityStatus, "TREND_", Trend),
        (SingularityStatus, "HARM_", Harm),
        (ControllerState, "MODE_", Mode),
        (PoseEstimate, "VERDICT_", Verdict),
        (LineFeatureArray, "LINES_", LinesVerdict),
        (CheckTarget.Response, "DECISION_", Decision),
    ],
)
def test_constants_are_those_of_the_core(message, prefix, values):
    assert constants(message, prefix) == {each.name: int(each) for each in values}


def test_every_kind_of_locus_and_mode_of_the_simulator_has_a_constant():
    assert set(constants(LocusDistance, "KIND_")) == {"NONE", *(each.name for each in Kind)}
    assert set(constants(SimulatorState, "MODE_")) == {"REALTIME", "LOCKSTEP"}


@pytest.mark.parametrize("name", [name for name in dir(plsing_msgs.msg) if name[0].isupper()] + SERVICES)
def test_every_position_says_its_frame(name):
    module = (
        plsing_msgs.msg
        if hasattr(plsing_msgs.msg, name)
        else importlib.import_module(
            "plsing_msgs.srv._" + {"CheckPose": "check_pose", "CheckTarget": "check_target"}[name.split("_")[0]]
        )
    )
    fields = getattr(module, name).get_fields_and_field_types()
    bare = [each for each in fields if fields[each].startswith(("geometry_msgs/Point", "geometry_msgs/Pose"))]
    bare = [each for each in bare if "Stamped" not in fields[each]]
    assert not bare or fields.keys() & {"header", "frame_id"}, bare
