# SPDX-License-Identifier: Apache-2.0
"""Runs the tutorial (docs/howto/tutorial.md) and draws its pictures into docs/figures: tutorial_*.png.

python3 docs/figures/tutorial_figures.py
"""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).resolve().parents[1]
PAGE = DOCS / "howto" / "tutorial.md"
# What `ros2` does for the tutorial, where ROS is not installed as such.
_ROS2 = """
ros2() {{
  if [ "$1" = pkg ]; then echo "{share}"; return; fi
  "{python}" -c "import sys; from plsing_ros.cli.$3 import main; sys.exit(main(sys.argv[1:]))" "${{@:4}}"
}}
"""


def commands() -> list[str]:
    """Return the shell blocks of the tutorial, in order."""
    return re.findall(r"^```bash\n(.*?)^```", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)


def run_tutorial(folder: Path) -> str:
    """Run all commands of the tutorial in a folder; return what they print."""
    script = "set -e\n" + _ROS2.format(share=DOCS.parent, python=sys.executable) + "\n".join(commands())
    done = subprocess.run(["bash", "-c", script], cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"the tutorial failed with {done.returncode}:\n{done.stdout}\n{done.stderr}")
    return done.stdout


def main() -> None:
    """Write the pictures."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print(run_tutorial(folder))
        pictures = {"selection": "chosen/selection.png", "path": "checked/path.png", "replay": "replayed/replay.png"}
        for picture, file in pictures.items():
            shutil.copy(folder / file, DOCS / "figures" / f"tutorial_{picture}.png")
        report = (folder / "evaluated" / "report.html").read_text("utf-8")
        first = re.findall(r"data:image/png;base64,([^']+)'", report)[0]
        (DOCS / "figures" / "tutorial_laws.png").write_bytes(base64.b64decode(first))


if __name__ == "__main__":
    main()
