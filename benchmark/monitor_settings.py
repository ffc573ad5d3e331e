# SPDX-License-Identifier: Apache-2.0
"""Runs in nominal conditions for the times of the monitor."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from benchmark.alert_settings import Setting, draw_setting

SEED, RATE = 303, 30.0


def settings(n: int = 0, law: str = "pinv") -> Iterator[Setting]:
    """Yield settings of a law at 30 Hz, of n lines if that is not 0."""
    number = 0
    while True:
        setting = draw_setting("nominal", SEED, number)
        number += 1
        if setting.kind == "any" and (n == 0 or len(setting.task.ends) == n):
            yield dataclasses.replace(setting, law=law, rate=RATE, chain=False, soft=False, limited=True)
