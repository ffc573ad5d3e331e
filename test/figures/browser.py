# SPDX-License-Identifier: Apache-2.0
"""Open a page in a real headless browser: the Chromium in the package kaleido.

That program loads a page of its own, hands requests from standard input to the JavaScript object kaleido_scopes of the
frame loaded last, and prints the answers. Here its page holds nothing but a frame with the page under test, and the
object is ours.
"""

from __future__ import annotations

import base64
import json
import subprocess
from dataclasses import dataclass
from pathlib import Path

WIDTH, HEIGHT = 1000, 700

_OPENER = """
(() => {
  const errors = [];
  const sleep = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));
  const scopes = {
    plotly: async (request) => {
      const page = window.underTest;
      try {
        const end = Date.now() + request.patience;
        const ready = () => page.eval(request.ready);
        while (!ready() && Date.now() < end) await sleep(50);
        if (!ready()) return {code: 1, message: "never true: " + request.ready, errors};
        const value = await page.eval("(async () => (" + request.script + "))()");
        return {code: 0, format: "json", value, errors, agent: navigator.userAgent};
      } catch (error) {
        return {code: 1, message: String(error) + "\\n" + error.stack, errors};
      }
    },
  };
  Object.defineProperty(window, "kaleido_scopes", {get: () => scopes, set: () => {}});
  window.addEventListener("DOMContentLoaded", () => {
    document.body.innerHTML = "";
    const frame = document.createElement("iframe");
    frame.style = "border: 0; width: %(width)dpx; height: %(height)dpx";
    frame.src = %(page)s;
    document.body.append(frame);
    window.underTest = frame.contentWindow;
    frame.onload = () => { frame.contentWindow.kaleido_scopes = scopes; window.underTest = frame.contentWindow; };
    const watch = () => {
      if (frame.contentWindow.onerror === null) frame.contentWindow.onerror = (message) => errors.push(String(message));
      if (document.readyState !== "complete") setTimeout(watch, 1);
    };
    watch();
  });
})();
"""


@dataclass(frozen=True)
class PageAnswer:
    """What the page answered.

    Attributes:
        value: Of the script.
        errors: JavaScript errors of the page.
        agent: The browser's name for itself.
    """

    value: object
    errors: list[str]
    agent: str


def ask_page(executable: Path, page: Path, folder: Path, ready: str, script: str, patience: float = 60.0) -> PageAnswer:
    """Open a page and return the value of a script in it.

    Args:
        executable: Of the package kaleido.
        page: HTML file.
        folder: For a file of ours.
        ready: JavaScript expression that is true when the page has done its work.
        script: JavaScript expression, may await.
        patience: How long to wait for that [s].
    """
    opener = folder / "opener.js"
    opener.write_text(_OPENER % {"width": WIDTH, "height": HEIGHT, "page": json.dumps(page.resolve().as_uri())})
    command = [
        str(executable),
        "plotly",
        f"--plotlyjs={opener.resolve().as_uri()}",
        "--disable-gpu",
        "--allow-file-access-from-files",
        "--disable-breakpad",
        "--disable-dev-shm-usage",
        "--no-sandbox",
    ]
    request = json.dumps({"format": "json", "ready": ready, "script": script, "patience": 1000.0 * patience})
    done = subprocess.run(
        command, input=request + "\n", capture_output=True, text=True, timeout=patience + 60.0, check=False
    )
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(lines) == 2, f"{done.stdout}\n{done.stderr}"
    answer = lines[1]
    assert answer["code"] == 0, answer
    return PageAnswer(answer["value"], answer["errors"], answer["agent"])


def png_of(data_url: object) -> bytes:
    """Return the PNG that a data URL holds."""
    assert isinstance(data_url, str)
    assert data_url.startswith("data:image/png;base64,")
    return base64.b64decode(data_url.split(",", 1)[1])
