# SPDX-License-Identifier: Apache-2.0
"""One hypothesis of where a camera is, followed through images and twists."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from plsing_ros import _core
from plsing_ros.arrays import Array
from plsing_ros.geometry import LineSet, Pose
from plsing_ros.parameters.pose_estimator import FilterParameters
from plsing_ros.pose.filter_motion import Agreement, BankUpdate, MotionBank, SeenLines, quantile

# A part is split while an image is further from linear than this where it tells least.
MAX_NONLINEARITY = 0.5
_MAX_SPLITS, MAX_PARTS = 3, 12
# A normal distribution as a mixture of three: offset and size in standard deviations, and share.
# Source: Tuggle, Zanetti, Automated splitting Gaussian mixture nonlinear measurement update (2018).
_PARTS = (
    (-1.0575154615, 0.6715662887, 0.2252246249),
    (0.0, 0.6715662887, 0.5495507502),
    (1.0575154615, 0.6715662887, 0.2252246249),
)
# Two parts become one when no more than this is lost, as a divergence. A part ends that is so much less likely, as
# -2 log of the ratio.
_MERGING_COST, _MAX_COST = 0.02, 18.0
# An image that is more improbable than this is not as expected.
_UNEXPECTED = 1e-3


@dataclass(frozen=True, eq=False)
class TrackUpdate:
    """What an image did to a track.

    Attributes:
        agreement: Whether it could be used.
        used: Which lines were, shape (k,).
        reversed: Which lines are seen against their direction, shape (k,).
        innovation: Root mean square of the innovation of the used lines, in standard deviations: 1 if all is as stated.
        cost: -2 log likelihood of the image.
    """

    agreement: Agreement
    used: list[bool]
    reversed: Array
    innovation: float
    cost: float


@dataclass(frozen=True, eq=False)
class _Part:
    """Of a track: a bank of filters, and -2 log of its share, but for what is common to all."""

    bank: MotionBank
    cost: float


class FilterTrack:
    """A mixture of iterated Kalman filters: one while the images are as good as linear, more while they are not.

    Args:
        lines: The scene, in the world frame.
        map_lines: The same for the core.
        T_world_camera: Where the camera is.
        covariance: Of position and orientation as in geometry_msgs/PoseWithCovariance, shape (6, 6).
        settings: Noise and gates.

    Source: docs/filter.md.
    """

    def __init__(
        self,
        lines: LineSet,
        map_lines: _core.FilterMap,
        T_world_camera: Pose,
        covariance: Array,
        settings: FilterParameters,
    ) -> None:
        self._map = map_lines
        self._settings = settings
        count = 0 if map_lines.exact else len(lines)
        self._parts = [_Part(MotionBank.start(T_world_camera, covariance, count, settings), 0.0)]
        self.cost = 0.0

    @property
    def state(self) -> _core.FilterState:
        """Mean and covariance of all parts."""
        if len(self._parts) == 1:
            return self._parts[0].bank.state
        return _core.FilterState.mixture([part.bank.state for part in self._parts], self._shares())

    @property
    def part_count(self) -> int:
        """Of how many normal distributions it is, at most MAX_PARTS."""
        return len(self._parts)

    @property
    def pose(self) -> Pose:
        """T_world_camera."""
        state = self.state
        return Pose(state.rotation, state.position)

    def predict(self, twist: Array | None, mean: Array | None, duration: float) -> None:
        """Move on for a duration [s], see MotionBank.predict."""
        for part in self._parts:
            part.bank.predict(twist, mean, duration)

    def update(self, rows: list[int], image: Array, covariances: Array) -> TrackUpdate:
        """Use an image, as far as it agrees; a track that it contradicts stays as it was.

        Args:
            rows: Of the k seen lines in the scene, k >= 1.
            image: Their l', shape (k, 3).
            covariances: Of angle and offset, shape (k, 3).
        """
        seen = SeenLines(self._map, rows, image, covariances)
        for agreement in (Agreement.AGREES, Agreement.MOVED, Agreement.MOSTLY):
            updates = self._updates(seen, agreement)
            if updates:
                return self._adopt(updates, agreement)
        return TrackUpdate(Agreement.CONTRADICTS, [False] * len(rows), np.zeros(len(rows)), math.inf, math.inf)

    def update_as_expected(self, rows: list[int], image: Array, covariances: Array) -> TrackUpdate | None:
        """Use an image if the robot moved as before and most lines are where expected; else stay as it was."""
        updates = self._updates(SeenLines(self._map, rows, image, covariances), Agreement.AGREES)
        if not updates:
            return None
        best = min(updates, key=lambda each: each[0])[1]
        count = sum(best.fit.fit.used)
        if 3 * count < 2 * len(rows) or best.surprise > quantile(2 * count, _UNEXPECTED):
            return None
        return self._adopt(updates, Agreement.AGREES)

    def _updates(self, seen: SeenLines, agreement: Agreement) -> list[tuple[float, BankUpdate]]:
        """Return what an image makes of all parts, with -2 log of each one's share."""
        room = MAX_PARTS - len(self._parts)
        found: list[tuple[float, BankUpdate]] = []
        for part in self._parts:
            of_part = self._split(seen, agreement, part, max(0, min(_MAX_SPLITS, room // 2)))
            room -= max(0, len(of_part) - 1)
            found += of_part
        return found

    def _split(self, seen: SeenLines, agreement: Agreement, part: _Part, splits: int) -> list[tuple[float, BankUpdate]]:
        """Return what an image makes of a part, which is split where it is not linear, up to so many times."""
        update = part.bank.updated(seen, agreement)
        if update is None:
            return []
        whole = [(part.cost + update.cost, update)]
        # Where the camera may be anywhere, parts would find a pose for any image.
        if splits == 0 or agreement is not Agreement.AGREES or not self._is_wide(update.fit.before):
            return whole
        curvature = update.fit.curvature(seen)
        if not curvature.nonlinearity > MAX_NONLINEARITY or not np.isfinite(curvature.by_pose).all():
            return whole
        parts: list[tuple[float, BankUpdate]] = []
        for offset, std, share in _PARTS:
            own = _Part(part.bank.part(curvature.by_pose, offset, std), part.cost - 2.0 * math.log(share))
            parts += self._split(seen, agreement, own, splits - 1)
        return parts or whole

    def _is_wide(self, state: _core.FilterState) -> bool:
        """Whether a state is POOR; others are small enough for images to be as good as linear."""
        deviation = np.sqrt(state.covariance.diagonal()).tolist()
        limits = self._settings
        return bool(
            max(deviation[:3]) > limits.max_position_deviation or max(deviation[3:]) > limits.max_rotation_deviation
        )

    def _adopt(self, updates: list[tuple[float, BankUpdate]], agreement: Agreement) -> TrackUpdate:
        cost, best = min(updates, key=lambda each: each[0])
        self._parts = [_Part(update.bank, each - cost) for each, update in updates if each - cost <= _MAX_COST]
        if len(self._parts) > 1:
            self._merge()
        own = cost - 2.0 * math.log(sum(math.exp(-0.5 * (each - cost)) for each, _ in updates))
        self.cost += own
        fit = best.fit.fit
        innovation, freedom = fit.innovation, 2 * sum(fit.used)
        return TrackUpdate(
            agreement,
            fit.used,
            innovation.reversed,
            math.sqrt(innovation.squared / max(1, freedom)),
            own,
        )

    def _shares(self) -> list[float]:
        shares = [math.exp(-0.5 * part.cost) for part in self._parts]
        return [each / sum(shares) for each in shares]

    def _merge(self) -> None:
        """Put parts together that are as good as one."""
        while len(self._parts) > 1:
            shares, banks = self._shares(), [part.bank for part in self._parts]
            lost, i, j = min(
                (banks[i].state.merging_cost(banks[j].state, shares[i], shares[j]), i, j)
                for i, j in combinations(range(len(banks)), 2)
            )
            if lost > _MERGING_COST and len(banks) <= MAX_PARTS:
                break
            both = banks[i].merged(banks[j], shares[i], shares[j])
            self._parts = [part for k, part in enumerate(self._parts) if k not in (i, j)]
            shares = [share for k, share in enumerate(shares) if k not in (i, j)] + [shares[i] + shares[j]]
            self._parts = [
                _Part(bank, -2.0 * math.log(share))
                for bank, share in zip([*(part.bank for part in self._parts), both], shares, strict=True)
            ]
