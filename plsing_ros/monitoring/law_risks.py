# SPDX-License-Identifier: Apache-2.0
"""What each law would do from a pose to a target: asked before anything moves."""

from __future__ import annotations

import dataclasses

from plsing_ros.arrays import Array
from plsing_ros.geometry import Pose
from plsing_ros.monitoring.risk import Risk
from plsing_ros.monitoring.rollout_setup import FRAME_PERIOD, MAX_STEPS, rollout_task
from plsing_ros.monitoring.run_clock import distance_between
from plsing_ros.monitoring.shaking import expected_shaking
from plsing_ros.parameters import ControllerParameters, MonitorParameters
from plsing_ros.planning.rollout import RolloutLaw, RunState
from plsing_ros.singularities import SingularSet, singular_set

LAWS = ("pinv", "dls", "adaptive_dls", "guarded", "detour", "position")
# Shaking by less than this at the target is not worth a word [m].
_SHAKES = 0.01


def risks_of_laws(
    pose: Pose, singular: SingularSet, target: Pose, parameters: MonitorParameters, ends: Array | None = None
) -> dict[str, Risk]:
    """Return what each law would do from a pose to the target, with the gain and the options of the parameters.

    Args:
        pose: T_world_camera at the start.
        singular: The scene.
        target: T_world_camera.
        parameters: In force.
        ends: Of the segments as far as they were seen, shape (n, 2, 3) [m]; those of the parameters go before.

    Raises:
        GeometryError: If the numbers do not make a task.
    """
    found = {}
    distance = distance_between(pose, target, parameters.degrees_of_freedom)[0]
    for name in LAWS:
        law = RolloutLaw.of_parameters(dataclasses.replace(parameters, law=name))
        task = rollout_task(singular, target, law, parameters, FRAME_PERIOD, ends=ends)
        starts = [pose] * parameters.samples
        outcomes = task.roll_out(starts, RunState(law.deadline, distance), 0)
        shaking = expected_shaking(task, parameters.samples, 0, MAX_STEPS)
        found[name] = Risk(0, outcomes, outcomes.risk, outcomes.demanded, shaking)
    return found


def laws_without_noise(parameters: ControllerParameters, start: Pose, target: Pose) -> str:
    """Return what each law would do with a controller's options, without noise and a robot of the usual limits.

    Args:
        parameters: Of the controller, with a scene.
        start: T_world_camera.
        target: T_world_camera.

    Raises:
        GeometryError: If the numbers do not make a task.
    """
    shared = {each.name for each in dataclasses.fields(MonitorParameters)}
    values = {
        each.name: getattr(parameters, each.name) for each in dataclasses.fields(parameters) if each.name in shared
    }
    loop = MonitorParameters(**values, samples=1)
    return laws_text(risks_of_laws(start, singular_set(parameters.lines()), target, loop))


def laws_text(risks: dict[str, Risk]) -> str:
    """Return what each law would do, in words."""
    parts = []
    for name, risk in risks.items():
        harm = f"{risk.probability:.0%}" + (f" ({risk.harm_text})" if risk.probability else "")
        shaking = risk.shaking or 0.0
        shakes = f", shakes by {shaking:.2g} m there" if shaking > _SHAKES else ""
        parts.append(f"{name}: harm {harm}, demand {risk.demand:.2g}{shakes}")
    return "; ".join(parts)
