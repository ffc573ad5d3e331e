# SPDX-License-Identifier: Apache-2.0
"""Write the reference pages that are made from code: parameters from their specifications, messages from msg_defs."""

from pathlib import Path

from plsing_ros.cli.parameter_files import NODES, node_parameters, yaml_text

MESSAGES = Path(__file__).resolve().parent.parent / "msg_defs"


def parameter_page() -> str:
    """Return the parameters of all nodes as Markdown tables."""
    lines = [
        "# Parameters",
        "",
        "Made from `plsing_ros/parameters/`. *Live* parameters can be changed while the node runs. The files in "
        "`config/` have the same content, to start from.",
    ]
    for node in NODES:
        lines += [
            "",
            f"## {node}",
            "",
            "| name | default | unit | allowed | live | meaning |",
            "|---|---|---|---|---|---|",
        ]
        for specification, default in node_parameters(node):
            cells = (
                f"`{specification.name}`",
                f"`{yaml_text(default)}`",
                specification.unit or "-",
                specification.range_text or "any",
                "yes" if specification.live else "no",
                specification.description.replace("|", r"\|"),
            )
            lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def message_page(folder: Path = MESSAGES) -> str:
    """Return every message and service of msg_defs, as it is defined."""
    lines = ["# Messages and services", "", "Made from `msg_defs/`, package `plsing_msgs`."]
    for kind in ("msg", "srv"):
        for file in sorted((folder / kind).glob(f"*.{kind}")):
            lines += ["", f"## {kind}/{file.stem}", "", "```text", file.read_text(encoding="utf-8").rstrip(), "```"]
    return "\n".join(lines) + "\n"


def write_reference_pages(folder: Path) -> None:
    """Write parameters.md and messages.md into a folder, where they are not up to date."""
    for name, content in (("parameters.md", parameter_page()), ("messages.md", message_page())):
        file = folder / name
        if not file.exists() or file.read_text(encoding="utf-8") != content:
            file.write_text(content, encoding="utf-8")
