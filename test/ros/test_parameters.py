# SPDX-License-Identifier: Apache-2.0
"""Parameters over the real parameter services: refused at the start, refused or taken live, described."""

import numpy as np
import pytest
import yaml
from messages import mentions
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, ListParameters, SetParametersAtomically
from rclpy.parameter import parameter_value_to_python

from plsing_msgs.msg import SingularLoci
from plsing_ros.errors import ParameterError
from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode
from plsing_ros.parameters import MonitorParameters

NODES = [FeatureSimulatorNode, ControllerNode, PoseEstimatorNode, SingularityMonitorNode]


@pytest.mark.parametrize("node", NODES)
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"gian": 0.5}, "unknown parameter 'gian'"),
        ({"lines.points": [0.0, 0.0]}, "have 2 and 12 numbers"),
        ({"lines.directions": [0.0] * 12}, "line 1: its direction is zero"),
        ({"lines.ids": [1, 1, 2, 3]}, "id 1 is given to more than one line"),
        ({"lines.ids": [1, 2, 3, 2**40]}, "allowed: -2147483648 to 2147483647"),
        ({"scene_frame": 5}, "parameter 'scene_frame' is 5; it must be a text"),
    ],
)
def test_a_bad_start_is_refused(ros, paper, node, parameters, message):
    with pytest.raises(ParameterError, match=message):
        ros.add(node, paper, parameters)


@pytest.mark.parametrize(
    ("node", "parameters", "message"),
    [
        (ControllerNode, {"gain": -1.0}, "parameter 'gain' is -1.0 1/s; allowed: 1e-06 to 1000 1/s"),
        (ControllerNode, {"gain": float("nan")}, "parameter 'gain' is nan; it must be finite"),
        (ControllerNode, {"gain": "fast"}, "parameter 'gain' is 'fast'; it must be a number 1/s"),
        (ControllerNode, {"gain": True}, "parameter 'gain' is True; it must be a number"),
        (ControllerNode, {"gian": 1.0}, "did you mean 'gain'?"),
        (ControllerNode, {"target.source": "psychic"}, "allowed: one of pose, topic"),
        (ControllerNode, {"target.orientation": [1.0, 1.0, 0.0, 0.0]}, "has length 1.41421, expected 1"),
        (ControllerNode, {"target.position": [1.0]}, "have 1 and 4 numbers"),
        (FeatureSimulatorNode, {"mode": "fast"}, "allowed: one of realtime, lockstep"),
        (FeatureSimulatorNode, {"seed": 1.5}, "parameter 'seed' is 1.5; it must be a whole number"),
        (FeatureSimulatorNode, {"time_step": 0.0}, "allowed: 0.0001 to 10 s"),
        (SingularityMonitorNode, {"warn.transversal_distance": 0.01}, "below 'critical.transversal_distance' = 0.02"),
    ],
)
def test_values_out_of_range_are_refused(ros, paper, node, parameters, message):
    with pytest.raises(ParameterError) as caught:
        ros.add(node, paper, parameters)
    assert message in str(caught.value)


@pytest.mark.parametrize("node", NODES)
def test_without_a_scene_it_says_how_to_give_one(ros, node):
    with pytest.raises(ParameterError, match="scene.*parameter file"):
        ros.add(node)


def test_a_target_in_a_line_is_refused(ros, paper):
    target = {"target.position": [3.0, 0.0, 0.0], "lines.ids": [1, 2, 3, 4]}
    on_the_first_line = ros.add(ControllerNode, paper, target)  # three of four lines are still seen
    ros.remove(on_the_first_line)
    three = {
        "lines.points": [0.0, 0.0, 0.0, 0.0, 0.0, 2.0, 3.0, 5.0, 0.0],
        "lines.directions": [1.0, 0.0, 0.0, 4.0, -5.0, 0.0, 3.0, 7.0, 3.0],
        "lines.ids": [1, 2, 3],
    }
    with pytest.raises(Exception, match=r"target pose.*\b2 usable"):
        ros.add(ControllerNode, paper, {**target, **three})


def value_of(value):
    if isinstance(value, bool):
        return ParameterValue(type=ParameterType.PARAMETER_BOOL, bool_value=value)
    if isinstance(value, float):
        return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=value)
    if isinstance(value, int):
        return ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=value)
    if isinstance(value, str):
        return ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    if isinstance(next(iter(value), 0.0), int):
        return ParameterValue(type=ParameterType.PARAMETER_INTEGER_ARRAY, integer_array_value=value)
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE_ARRAY, double_array_value=value)


def set_live(ros, node, **values):
    request = SetParametersAtomically.Request(
        parameters=[
            ParameterMessage(name=name.replace("__", "."), value=value_of(value)) for name, value in values.items()
        ]
    )
    return ros.call(SetParametersAtomically, f"{node}/set_parameters_atomically", request).result


def test_live_changes_are_taken_or_refused_as_a_whole(ros, paper):
    node = ros.add(SingularityMonitorNode, paper)
    assert set_live(
        ros, "singularity_monitor", warn__transversal_distance=0.5, critical__transversal_distance=0.3
    ).successful
    assert (node.parameters.warn_transversal_distance, node.parameters.critical_transversal_distance) == (0.5, 0.3)
    refused = set_live(ros, "singularity_monitor", warn__transversal_distance=0.9, debounce__raise=0)
    assert not refused.successful
    assert node.parameters.warn_transversal_distance == 0.5
    refused = set_live(ros, "singularity_monitor", warn__transversal_distance=0.1)
    assert not refused.successful and mentions(refused.reason, "'critical.transversal_distance'", 0.3)
    assert node.get_parameter("warn.transversal_distance").value == 0.5


# The worse the larger they are, and of the same size.
SMALL = ("position_std", "rotation_std", "shaking")


def another(name, value):
    """An allowed value other than the present one; in order of declaration no rule between values is broken."""
    rising = {"warn.": 1e-3, "critical.": 1e-2}
    if name.split(".")[-1].removesuffix("_exit") in SMALL and name.startswith(tuple(rising)):
        return (
            5e-4 if name.endswith("_exit") else next(high for level, high in rising.items() if name.startswith(level))
        )
    of_risk = {"warn.risk": 0.45, "warn.risk_exit": 0.3, "critical.risk": 0.8, "critical.risk_exit": 0.7}
    of_risk |= {"warn.demand_exit": 0.5, "critical.demand_exit": 1.5}
    if name in of_risk:
        return of_risk[name]
    if name.endswith(".z_exit"):
        return 5.0
    if name.endswith("_exit"):
        return 1.0 if "speed" in name or ".inverse" in name else 2.0
    if name.startswith("warn."):
        return 1.2 * value + 1e-3
    if name.startswith("critical."):
        return 0.6 * value + 1e-4
    special = {"target.orientation": [0.0, 0.0, 0.0, 1.0], "lines.ids": [1, 2, 3, 5], "condition_thresholds": "both"}
    special |= {"degrees_of_freedom": [1, 1, 1, 1, 1, 0], "lines.ends": [0.1 * each for each in range(24)]}
    if name in special:
        return special[name]
    choices = MonitorParameters.specifications()[name][1].choices
    if choices:
        return next(each for each in choices if each != value)
    if isinstance(value, bool):
        return not value
    if isinstance(value, tuple):
        return [each + 0.05 for each in value]
    return value + 1 if isinstance(value, int) else 1.1 * value + 1e-3


def test_each_live_parameter_is_taken_and_a_set_with_one_bad_value_is_refused_whole(ros, paper):
    node = ros.add(SingularityMonitorNode, paper, {"warn.relative_inverse_condition_number_exit": 0.0})
    for name, (_, specification) in MonitorParameters.specifications().items():
        before = node.parameters.values()
        if not specification.live:
            assert not set_live(ros, "singularity_monitor", **{name: before[name]}).successful, name
            continue
        value = another(name, before[name])
        refused = set_live(ros, "singularity_monitor", **{name: value, "rate_window": 1})
        assert not refused.successful and "rate_window" in refused.reason, name
        assert node.parameters.values() == before, name
        result = set_live(ros, "singularity_monitor", **{name: value})
        assert result.successful, (name, result.reason)
        after = node.parameters.values()
        assert list(np.atleast_1d(after[name])) == list(np.atleast_1d(value)) != list(np.atleast_1d(before[name])), name
        assert {each for each in after if after[each] != before[each]} == {name}


def test_a_whole_number_is_taken_for_a_length(ros, paper):
    node = ros.add(SingularityMonitorNode, paper)
    assert set_live(ros, "singularity_monitor", warn__transversal_distance=2).successful
    assert node.parameters.warn_transversal_distance == 2.0


def test_whole_numbers_are_taken_for_a_position(ros, paper, tmp_path):
    file = tmp_path / "whole.yaml"
    text = paper.read_text().replace("position: [0.6962, -4.637, 7.8]", "position: [1, 2, 3]")
    file.write_text(text.replace("gain: 0.1", "gain: 2"))
    node = ros.add(ControllerNode, file)
    assert node.parameters.target_position == (1.0, 2.0, 3.0) and node.parameters.gain == 2.0
    assert set_live(ros, "controller", target__position=[4, 5, 6]).successful
    assert node.parameters.target_position == (4.0, 5.0, 6.0)
    assert list(node.get_parameter("target.position").value) == [4.0, 5.0, 6.0]


@pytest.mark.parametrize("value", ["hello", True, [1.0, 2.0]])
def test_a_value_of_another_type_is_refused_and_leaves_the_described_type(ros, paper, value):
    node = ros.add(ControllerNode, paper)
    assert not set_live(ros, "controller", gain=value).successful
    request = DescribeParameters.Request(names=["gain"])
    described = ros.call(DescribeParameters, "controller/describe_parameters", request).descriptors[0]
    assert described.type == ParameterType.PARAMETER_DOUBLE and not described.dynamic_typing
    assert node.get_parameter("gain").value == node.parameters.gain == 0.1


def test_an_unknown_name_is_refused_live_with_the_nearest_one(ros, paper):
    ros.add(ControllerNode, paper)
    refused = set_live(ros, "controller", gian=1.0)
    assert not refused.successful and mentions(refused.reason, "'gain'")


def test_ids_can_be_taken_back_with_an_empty_list_of_any_type(ros, paper):
    node = ros.add(ControllerNode, paper, {"lines.ids": [5, 6, 7, 8]})
    empty = ParameterValue(type=ParameterType.PARAMETER_BOOL_ARRAY)  # what `ros2 param set ... "[]"` sends
    request = SetParametersAtomically.Request(parameters=[ParameterMessage(name="lines.ids", value=empty)])
    assert ros.call(SetParametersAtomically, "controller/set_parameters_atomically", request).result.successful
    assert node.parameters.lines_ids == () and node.parameters.lines().ids == (1, 2, 3, 4)


def dump(ros, name):
    """What `ros2 param dump` prints: all parameters as the services tell them, nested at their dots."""
    names = ros.call(ListParameters, f"{name}/list_parameters", ListParameters.Request()).result.names
    values = ros.call(GetParameters, f"{name}/get_parameters", GetParameters.Request(names=names)).values
    nested = {}
    for parameter, value in zip(names, values, strict=True):
        *path, leaf = parameter.split(".")
        inner = nested
        for key in path:
            inner = inner.setdefault(key, {})
        inner[leaf] = parameter_value_to_python(value)
    return yaml.dump({f"/{name}": {"ros__parameters": nested}}, default_flow_style=False)


@pytest.mark.parametrize("node", NODES)
def test_a_node_loads_its_own_dump(ros, paper, tmp_path, node):
    gain = {"gain": 1e-6} if node is ControllerNode else {}
    first = ros.add(node, paper, gain)
    dumped = dump(ros, first.get_name())
    before = first.parameters
    ros.remove(first)
    for text in (dumped, dumped.replace("1.0e-06", "1e-06")):
        file = tmp_path / "dump.yaml"
        file.write_text(text)
        again = ros.add(node, file)
        assert again.parameters == before
        assert not gain or again.parameters.gain == 1e-6
        assert dump(ros, again.get_name()) == dumped
        ros.remove(again)


def test_what_is_fixed_at_the_start_cannot_be_changed(ros, paper):
    ros.add(FeatureSimulatorNode, paper)
    assert not set_live(ros, "feature_simulator", time_step=0.1).successful


def test_a_changed_scene_has_its_loci_published_again(ros, paper):
    ros.add(SingularityMonitorNode, paper)
    loci = ros.collect(SingularLoci, "singular_loci", qos.LATCHED)
    ros.spin_until(lambda: len(loci) == 1, "the latched loci")
    moved = [each + 1.0 for each in loci[0].line_points]
    assert set_live(ros, "singularity_monitor", lines__points=moved).successful
    ros.spin_until(lambda: len(loci) == 2, "the loci of the changed scene")
    np.testing.assert_allclose(
        np.reshape(loci[1].isolated_points, (-1, 3)), np.reshape(loci[0].isolated_points, (-1, 3)) + 1.0, atol=1e-6
    )


@pytest.mark.parametrize("node", NODES)
def test_every_parameter_is_described(ros, paper, node):
    created = ros.add(node, paper)
    names = list(type(created.parameters).specifications())
    response = ros.call(
        DescribeParameters, f"{created.get_name()}/describe_parameters", DescribeParameters.Request(names=names)
    )
    for name, descriptor in zip(names, response.descriptors, strict=True):
        specification = type(created.parameters).specifications()[name][1]
        assert specification.description in descriptor.description
        assert not specification.unit or f"[{specification.unit}]" in descriptor.description
        assert descriptor.additional_constraints == specification.range_text
        assert descriptor.read_only is not specification.live
        assert not descriptor.dynamic_typing and descriptor.type != ParameterType.PARAMETER_NOT_SET
