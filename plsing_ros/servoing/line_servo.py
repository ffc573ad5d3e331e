"""The controller's cycle without ROS: an observation in, a command out."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import numpy as np

from plsing_ros.arrays import Array
from plsing_ros.errors import ObservationError
from plsing_ros.features import LineObservation, conditioning, interaction_matrix
from plsing_ros.parameters import ControllerParameters
from plsing_ros.servoing.control_law import pinv_twist
from plsing_ros.servoing.freshness import Freshness

MINIMUM_LINES = 3


class Mode(enum.IntEnum):
    """What the controller is doing; values as in plsing_msgs/ControllerState."""

    WAITING = 0
    SERVOING = 1
    CONVERGED = 2
    HALTED = 3
    DISABLED = 4


@dataclass(frozen=True, eq=False)
class Command:
    """What to do now.

    Attributes:
        mode: What the controller is doing.
        reason: Why, in words; empty while servoing.
        twist: (v, omega) of the camera in its optical frame, shape (6,) [m/s, rad/s]; always finite, zero unless
            servoing or converged; not to be published while waiting.
        error_norm: |s - s*|, 0 if unknown.
        inverse_condition_number: Of L, 0 if unknown.
    """

    mode: Mode
    reason: str = ""
    twist: Array = field(default_factory=lambda: np.zeros(6))
    error_norm: float = 0.0
    inverse_condition_number: float = 0.0


class LineServo:
    """Turns observations into commands; commands zero and says why whenever it cannot trust its input."""

    def __init__(self, parameters: ControllerParameters) -> None:
        self.enabled = True
        self._target: dict[int, Array] = {}
        self._freshness = Freshness("features", parameters.features_timeout, parameters.future_tolerance)
        self.parameters = parameters

    @property
    def parameters(self) -> ControllerParameters:
        """The parameters in force; setting them takes effect at the next step."""
        return self._parameters

    @parameters.setter
    def parameters(self, parameters: ControllerParameters) -> None:
        target = self._target
        if parameters.target_source == "pose":
            # Raises for a target without an image, before anything has changed.
            seen = parameters.lines().transformed(parameters.target_pose().inverse(), "camera at the target")
            target = _features_by_id(LineObservation.of_lines(seen), "target pose")
        self._target = target
        self._freshness.timeout = parameters.features_timeout
        self._freshness.future_tolerance = parameters.future_tolerance
        self._parameters = parameters

    def set_target(self, desired: LineObservation) -> None:
        """Use these image lines as s* from now on.

        Raises:
            ObservationError: If fewer than three of them are usable.
        """
        self._target = _features_by_id(desired, "desired features")

    def step(self, observation: LineObservation, stamp: int, now: int) -> Command:
        """Return the command for an observation.

        Lines are matched by id; those without a target or out of sight are left out.

        Args:
            observation: What the camera sees, with 3-D lines.
            stamp: Of the observation [ns].
            now: Of the node clock [ns].

        Raises:
            ObservationError: If the observation cannot be used; call halt with the reason.
        """
        if not self.enabled:
            return Command(Mode.DISABLED, "switched off by ~/enable")
        refusal = self._freshness.refusal(stamp, now)
        if refusal is not None:
            return Command(Mode.HALTED, refusal)
        if not self._target:
            return Command(Mode.WAITING, "no target: no desired features received yet")
        if observation.lines_camera is None:
            if observation.usable_ids:
                raise ObservationError(
                    "features have no 3-D lines (directions and moments are empty), which the interaction matrix needs"
                )
            raise ObservationError("none of the observed lines is usable")
        rows = [row for row, i in enumerate(observation.usable_ids) if i in self._target]
        if len(rows) < MINIMUM_LINES:
            raise ObservationError(
                f"only {len(rows)} usable line(s) with a target (usable: {list(observation.usable_ids)}, target: "
                f"{list(self._target)}); at least {MINIMUM_LINES} are needed"
            )
        lines = observation.lines_camera.select(rows)
        desired = np.array([self._target[i] for i in lines.ids])
        error = (observation.usable_image_lines[rows] - desired).ravel()
        interaction = interaction_matrix(lines)
        twist = pinv_twist(interaction, error, self.parameters.gain, self.parameters.pinv_threshold)
        if not np.isfinite(twist).all():
            return self.halt(f"the control law gave a twist that is not finite: {twist.tolist()}")
        error_norm = float(np.linalg.norm(error))
        converged = error_norm <= self.parameters.converged_error
        return Command(
            Mode.CONVERGED if converged else Mode.SERVOING,
            f"error norm {error_norm:.3g} is below {self.parameters.converged_error:g}" if converged else "",
            twist,
            error_norm,
            conditioning(interaction).inverse_condition_number,
        )

    def halt(self, reason: str) -> Command:
        """Return a command of zero twist with the reason, for features that cannot be used or for a shutdown."""
        self._freshness.note_problem(reason)
        return Command(Mode.HALTED if self.enabled else Mode.DISABLED, reason)

    def silence(self, now: int) -> Command | None:
        """Return the command for input that has stopped, or None while it is recent enough (now in ns)."""
        if not self.enabled:
            return Command(Mode.DISABLED, "switched off by ~/enable")
        reason = self._freshness.silence(now)
        if reason is None:
            return None
        return Command(Mode.WAITING if self._freshness.last_stamp is None else Mode.HALTED, reason)


def _features_by_id(observation: LineObservation, what: str) -> dict[int, Array]:
    ids = observation.usable_ids
    if len(ids) < MINIMUM_LINES:
        raise ObservationError(
            f"{what}: only {len(ids)} usable line(s) ({list(ids)}) of {len(observation.ids)}; "
            f"at least {MINIMUM_LINES} are needed"
        )
    return dict(zip(ids, observation.usable_image_lines, strict=True))
