# SPDX-License-Identifier: Apache-2.0
import sys
from pathlib import Path

from hypothesis import HealthCheck, settings

# A loaded machine is no failure: nothing here judges by the wall clock.
settings.register_profile("without_clock", deadline=None, suppress_health_check=[HealthCheck.too_slow])
# `make test-quick` draws fewer values for each property.
settings.register_profile("quick", settings.get_profile("without_clock"), max_examples=20)
settings.load_profile("without_clock")

# `colcon test` starts here also where the package is installed elsewhere: then that one is to be tested, and not the
# sources without their compiled part. Packages that are not installed (paper, benchmark) are still found here.
ROOT = Path(__file__).resolve().parents[1]
if not any((ROOT / "plsing_ros" / "_core").glob("compiled*.so")):
    sys.path[:] = [each for each in sys.path if Path(each).resolve() != ROOT] + [str(ROOT)]
