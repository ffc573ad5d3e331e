#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Put the SPDX line into every source that has none: python3 tools/spdx.py [--check]."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
LINE = "SPDX-License-Identifier: Apache-2.0"
SIGNS = {".py": "#", ".pyi": "#", ".msg": "#", ".srv": "#", ".c": "//", ".h": "//", ".cpp": "//", ".hpp": "//"}


def with_line(text, sign):
    """Return a source with the line at its top, below #! if there is one."""
    first, newline, rest = text.partition("\n")
    if first.startswith("#!"):
        return f"{first}\n{sign} {LINE}\n{rest}"
    return f"{sign} {LINE}\n{text}"


def main():
    """Write, or with --check only name, the sources without the line; return 1 if there were any to check."""
    names = subprocess.run(["git", "ls-files"], cwd=str(ROOT), stdout=subprocess.PIPE, check=True).stdout.decode()
    lacking = []
    for file in (ROOT / name for name in names.splitlines()):
        if file.suffix in SIGNS and file.exists():
            text = file.read_text(encoding="utf-8")
            if LINE not in "\n".join(text.split("\n", 2)[:2]):
                lacking.append((file, text))
    for file, text in lacking:
        print(f"{file.relative_to(ROOT)}: no {LINE}")
        if "--check" not in sys.argv:
            file.write_text(with_line(text, SIGNS[file.suffix]), encoding="utf-8")
    return int(bool(lacking) and "--check" in sys.argv)


if __name__ == "__main__":
    sys.exit(main())
