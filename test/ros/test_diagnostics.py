# SPDX-License-Identifier: Apache-2.0
"""Every node tells /diagnostics how it is, with what and without input."""

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from plsing_ros.nodes import qos
from plsing_ros.nodes.controller import ControllerNode
from plsing_ros.nodes.feature_simulator import FeatureSimulatorNode
from plsing_ros.nodes.pose_estimator import PoseEstimatorNode
from plsing_ros.nodes.singularity_monitor import SingularityMonitorNode


@pytest.mark.parametrize("node", [ControllerNode, FeatureSimulatorNode, PoseEstimatorNode, SingularityMonitorNode])
def test_every_node_reports_once_a_second(ros, paper, node):
    diagnostics = ros.collect(DiagnosticArray, "/diagnostics", qos.STATUS)
    created = ros.add(node, paper)
    ros.spin_for(2.6)
    assert 2 <= len(diagnostics) <= 3
    status = diagnostics[-1].status[0]
    assert status.name == f"{created.get_name()}: state"
    assert status.message
    assert {"rate [Hz]", "largest latency [s]"} <= {each.key for each in status.values}


def test_a_controller_that_servoes_and_one_that_starves(ros, paper):
    diagnostics = ros.collect(DiagnosticArray, "/diagnostics", qos.STATUS)
    ros.add(ControllerNode, paper, {"features_timeout": 0.5})
    simulator = ros.add(FeatureSimulatorNode, paper)

    def latest(name):
        return next((each.status[0] for each in reversed(diagnostics) if name in each.status[0].name), None)

    ros.spin_until(lambda: latest("feature_simulator"), "the simulator's report")
    ros.spin_until(lambda: latest("controller") and latest("controller").message == "SERVOING", "servoing")
    assert float(latest("feature_simulator").values[0].value) > 5.0
    ros.remove(simulator)
    ros.spin_until(lambda: latest("controller").message.startswith("HALTED no features for"), "the halt")
