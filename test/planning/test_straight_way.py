# SPDX-License-Identifier: Apache-2.0
"""When the straight way is gone by the pose: across a locus, but not where lines leave the view on it."""

import re

import numpy as np
from hypothesis import example, given, settings
from messages import mentions
from strategies import numbers, vectors

from plsing_ros.geometry import LineSet, Pose
from plsing_ros.geometry.scene_file import read_scene
from plsing_ros.parameters.config_files import config_file
from plsing_ros.planning.detour import Decision, DetourOptions, plan_path
from plsing_ros.planning.rollout import RolloutLaw
from plsing_ros.planning.straight_way import KnownPose, plan_by_risk
from plsing_ros.simulation import near_transversal
from plsing_ros.singularities import singular_set

PAPER = singular_set(read_scene(config_file("paper_p4l.yaml")))
TARGET = Pose.from_quaternion(near_transversal.TARGET_POSITION, near_transversal.ORIENTATION)
START = Pose.from_quaternion(near_transversal.STARTS[1].position, near_transversal.ORIENTATION)
LAW = RolloutLaw(law="detour", gain=0.5, max_linear_speed=0.25, max_angular_speed=1.0)
BY_RISK = DetourOptions(risk_margin=0.05)
# Seen from the sides of this scene, a camera that goes straight has some lines out of a narrow view.
CROSS = singular_set(
    LineSet.from_points_directions(
        [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, -1.0, -0.5], [0.0, 1.0, 0.0]],
        [[0.2, 1.0, 0.1], [-0.1, 1.0, 0.3], [1.0, 0.2, 0.2], [1.0, -0.3, 0.0]],
    )
)
HALF = 0.25


def known(position=1e-3, rotation=1e-3, lasts=False):
    return KnownPose(LAW, np.diag(np.repeat([position**2, rotation**2], 3)), lasts)


def beyond_the_transversal(share):
    """A start from which the straight way to the target crosses a transversal."""
    transversal = PAPER.transversals[0]
    foot = transversal.point + transversal.direction * (
        transversal.direction @ (TARGET.translation - transversal.point)
    )
    return Pose(TARGET.rotation, TARGET.translation + (1.0 + share) * (foot - TARGET.translation))


@given(share=numbers(0.3, 1.0), lasts=numbers(0.0, 1.0))
@settings(max_examples=10, deadline=None)
def test_a_pose_that_is_known_is_what_crosses_a_locus(share, lasts):
    start = beyond_the_transversal(share)
    assert plan_path(PAPER, start, TARGET, BY_RISK).decision is not Decision.STRAIGHT
    plan = plan_by_risk(PAPER, start, TARGET, BY_RISK, known(lasts=lasts > 0.5))
    assert plan.decision is Decision.STRAIGHT and plan.by_pose and "risk 0%" in plan.reason
    ends = plan.path.sampled(2)
    assert ends[0].is_close(start, 1e-9) and ends[-1].is_close(TARGET, 1e-9)


@given(share=numbers(0.3, 1.0))
@settings(max_examples=5, deadline=None)
def test_without_such_a_pose_or_where_it_is_switched_off_the_way_leads_round(share):
    start = beyond_the_transversal(share)
    round_it = plan_path(PAPER, start, TARGET, DetourOptions())
    for plan in (
        plan_by_risk(PAPER, start, TARGET, BY_RISK, None),
        plan_by_risk(PAPER, start, TARGET, DetourOptions(), known()),
    ):
        assert (plan.decision, plan.reason, plan.by_pose) == (round_it.decision, round_it.reason, False)


def test_a_target_that_is_refused_stays_refused():
    transversal = PAPER.transversals[0]
    on_it = transversal.point + transversal.direction * (
        transversal.direction @ (TARGET.translation - transversal.point)
    )
    plan = plan_by_risk(PAPER, START, Pose(TARGET.rotation, on_it), BY_RISK, known())
    assert plan.decision is Decision.REFUSE and mentions(plan.reason, "target", "transversal 1")


def seen(pose):
    """How many lines have a point in the image, by points strewn on them."""
    along = np.linspace(-20.0, 20.0, 8001)[:, np.newaxis]
    count = 0
    for point, direction in zip(CROSS.lines.point, CROSS.lines.direction, strict=True):
        p = (point + along * direction - pose.translation) @ pose.rotation
        front = p[p[:, 2] > 0.0]
        count += bool((np.abs(front[:, :2]) <= HALF * front[:, 2:]).all(axis=1).any())
    return count


def is_riskier(reason):
    """Whether a reason gives a risk of the straight way that is higher than that of the other by the margin."""
    found = re.search(r"predicted risk (\d+)%, straight by the pose (\d+)%", reason)
    return found is not None and int(found[2]) >= int(found[1]) + 5


@given(shift=vectors(6, -0.1, 0.1))
@example(shift=np.array([0.0625, 0.0, 0.0, 0.03125, -0.015625, 0.015625]))
@settings(max_examples=8, deadline=None)
def test_the_way_leads_round_where_too_few_lines_are_in_view_on_the_straight_one(shift):
    start, target = (
        Pose.look_at(np.add(place, off), [0.0, 0.0, 0.0], down=[0.0, 1.0, 0.0])
        for place, off in (([-0.13, -1.04, -2.86], shift[:3]), ([1.48, 0.66, -3.86], shift[3:]))
    )
    options = DetourOptions(half_view=(HALF, HALF), risk_margin=0.05)
    plan = plan_by_risk(CROSS, start, target, options, known())
    blind = plan_by_risk(CROSS, start, target, BY_RISK, known())
    assert blind.by_pose
    straight = [seen(pose) for pose in blind.path.sampled(60)]
    at_ends = min(straight[0], straight[-1])
    if plan.by_pose:
        # Points at the edge of the image, and poses between these, may count otherwise.
        assert min(straight) >= min(at_ends, 4) - 1
    elif plan.path is not None and "every path" not in plan.reason:
        assert mentions(plan.reason, "view") or is_riskier(plan.reason)
        assert min(seen(pose) for pose in plan.path.sampled(60)) >= at_ends - 1
        assert min(straight) <= min(at_ends, 4)
