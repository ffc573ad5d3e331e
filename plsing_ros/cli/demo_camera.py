# SPDX-License-Identifier: Apache-2.0
"""Command demo_camera: a rendered arm servos on an object by its wrist camera's images, with the monitor's alerts."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from plsing_ros.cli.command import make_folder, run_command
from plsing_ros.errors import PlsingError
from plsing_ros.figures.camera_runs import save_contact_sheet, save_curves
from plsing_ros.parameters.arm_simulator import ArmSimulatorParameters
from plsing_ros.parameters.config_files import config_file
from plsing_ros.parameters.parameter_file import read_parameters
from plsing_ros.simulation.arm_simulation import ArmSimulation
from plsing_ros.simulation.camera_record import CameraRecord
from plsing_ros.simulation.camera_scene import SCENE_FILE, CameraScene, camera_scenes
from plsing_ros.simulation.run_record import Alert
from plsing_ros.testing.camera_run import run_camera_scene

_EPILOG = """examples:
  demo_camera                        all runs
  demo_camera --runs approach        only the first
  demo_camera --output /tmp/figures  write the pictures there

The exit code is 1 if a run that should arrive does not. Needs OpenCV; MuJoCo draws the arm where it is installed:
pip install 'mujoco>=3.1,<3.4' opencv-python-headless; sudo apt install libosmesa6"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the demo; return the exit code."""
    scenes = camera_scenes()
    parser = argparse.ArgumentParser(
        description="Run arm simulator, line tracker, pose estimator, controller and monitor as processes over real "
        "topics: an approach, and a path across a transversal with the plain law and with the recommended one.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    names = [scene.name for scene in scenes]
    parser.add_argument("--runs", nargs="+", choices=names, default=names, help="which runs")
    parser.add_argument("--output", type=Path, default=Path("demo_output"), help="folder of the pictures (%(default)s)")
    options = parser.parse_args(argv)
    chosen = [scene for scene in scenes if scene.name in options.runs]
    return run_command("demo_camera", lambda: _run(chosen, options.output))


def _run(scenes: Sequence[CameraScene], folder: Path) -> int:
    make_folder(folder, "write the pictures", "--output")
    simulation = ArmSimulation(
        ArmSimulatorParameters.from_values(read_parameters(config_file(SCENE_FILE), "arm_simulator"))
    )
    print(f"{simulation.renderer}")
    records = [_run_scene(scene) for scene in scenes]
    print()
    for record in records:
        print(record)
    print()
    for record in records:
        if record.pictures:
            print(f"picture: {save_contact_sheet(record, simulation.look_at, folder)}")
    for file in save_curves(records, folder):
        print(f"figure: {file}")
    missed = [record.scene.name for record in records if record.scene.must_arrive and not record.arrived]
    if missed:
        raise PlsingError(f"{' and '.join(missed)} did not arrive at the target; the last words above say why")
    return 0


def _run_scene(scene: CameraScene) -> CameraRecord:
    print(f"\n{scene.name}: {scene.note}")
    told = [-1.0]

    def on_alert(alert: Alert) -> None:
        print(f"  {alert.time:6.2f} s  {alert.text}", flush=True)

    def on_distance(at: float, distance: float) -> None:
        if at >= told[0] + 1.0:
            told[0] = at
            print(f"  {at:6.2f} s  {1e3 * distance:.1f} mm from the target", flush=True)

    return run_camera_scene(scene, on_alert, on_distance)


if __name__ == "__main__":
    raise SystemExit(main())
