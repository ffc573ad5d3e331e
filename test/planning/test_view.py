# SPDX-License-Identifier: Apache-2.0
"""Lines in the field of view, beside points strewn on them; and paths that keep them there."""

import numpy as np
from hypothesis import assume, given, settings
from scipy.spatial.transform import Rotation
from strategies import line_sets, numbers, poses, vectors

from plsing_ros.geometry import LineSet, Pose
from plsing_ros.planning.detour import Decision, DetourOptions, plan_path
from plsing_ros.planning.path_conditions import lines_in_view
from plsing_ros.singularities import singular_set

HALF = (0.6, 0.45)
# Along a line, dense near its point nearest to the origin.
ALONG = np.concatenate([-np.geomspace(1e4, 1e-3, 4000), [0.0], np.geomspace(1e-3, 1e4, 4000)])
SCENE = LineSet.from_points_directions(
    [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.5], [0.0, -1.0, -0.5], [0.0, 1.0, 0.0]],
    [[0.2, 1.0, 0.1], [-0.1, 1.0, 0.3], [1.0, 0.2, 0.2], [1.0, -0.3, 0.0]],
)


def seen_by_points(lines, pose, widened):
    count = 0
    for point, direction in zip(lines.point, lines.direction, strict=True):
        p = (point + ALONG[:, np.newaxis] * direction - pose.translation) @ pose.rotation
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = np.abs(p[:, 0] / p[:, 2]), np.abs(p[:, 1] / p[:, 2])
        count += bool(((p[:, 2] > 0.0) & (x <= widened * HALF[0]) & (y <= widened * HALF[1])).any())
    return count


@given(lines=line_sets(max_size=4), pose=poses())
@settings(deadline=None)
def test_lines_in_view_are_those_with_a_point_in_the_image(lines, pose):
    assume(np.linalg.norm(lines.transformed(pose.inverse(), "camera").moment, axis=1).min() > 0.05)
    # Not those that only touch its edge, and not what comes into view beyond the points.
    assume(seen_by_points(lines, pose, 0.97) == seen_by_points(lines, pose, 1.03))
    counted = lines_in_view(lines, pose.rotation[np.newaxis], pose.translation[np.newaxis], HALF)
    far = lines_in_view(
        lines, pose.rotation[np.newaxis], pose.translation[np.newaxis], (1.03 * HALF[0], 1.03 * HALF[1])
    )
    assert counted[0] >= seen_by_points(lines, pose, 0.97)
    assert counted[0] <= far[0]


@given(
    start=vectors(3, -1.0, 1.0), target=vectors(3, -1.0, 1.0), turns=vectors(6, -0.35, 0.35), depth=numbers(2.0, 3.5)
)
@settings(deadline=None, max_examples=15)
def test_a_path_keeps_lines_in_view_or_says_that_it_does_not(start, target, turns, depth):
    ends = [
        Pose(Rotation.from_rotvec(turn).as_matrix(), [place[0], place[1], 0.4 * place[2] - depth])
        for place, turn in ((start, turns[:3]), (target, turns[3:]))
    ]
    plan = plan_path(singular_set(SCENE), *ends, DetourOptions(half_view=HALF))
    assume(plan.decision is not Decision.REFUSE and "leave the view" not in plan.reason)
    least = min(seen_by_points(SCENE, pose, 0.99) for pose in ends)
    assert all(seen_by_points(SCENE, pose, 1.03) >= least for pose in plan.path.sampled(40))


def test_a_path_that_would_look_away_is_tilted_or_goes_round():
    rng, singular, narrow = np.random.default_rng(0), singular_set(SCENE), (0.4, 0.3)
    kept = 0
    for _ in range(8):
        centers = rng.normal(size=(2, 3)) * [2.0, 2.0, 1.0] + [0.0, 0.0, -3.0]
        ends = [Pose.look_at(center, 0.8 * rng.normal(size=3)) for center in centers]
        plans = [plan_path(singular, *ends), plan_path(singular, *ends, DetourOptions(half_view=narrow))]
        if plans[0].path is None or "leave the view" in plans[1].reason:
            continue
        fewest = []
        for plan in plans:
            path = plan.path.sampled(60)
            rotation, position = (
                np.array([getattr(each, name) for each in path]) for name in ("rotation", "translation")
            )
            counts = lines_in_view(SCENE, rotation, position, narrow)
            fewest.append(counts.min() - min(counts[0], counts[-1]))
        assert fewest[1] >= 0
        kept += fewest[0] < 0
    assert kept
