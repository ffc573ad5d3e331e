# SPDX-License-Identifier: Apache-2.0
"""What a message must name: values, limits and things, in whatever sentence."""

import re


def mentions(message, *named):
    """Return whether a message names each of these, a number or a word not as a part of another one."""
    return all(re.search(rf"(?<![\w.]){re.escape(str(each))}(?!\w|\.\d)", message) for each in named)
