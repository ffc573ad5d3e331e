# SPDX-License-Identifier: Apache-2.0
"""A page that needs no other file: text, tables and pictures."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path

_STYLE = (
    "body{font-family:sans-serif;max-width:70em;margin:2em auto;padding:0 1em;line-height:1.4}"
    "td,th{padding:.2em .8em .2em 0;text-align:left;vertical-align:top}"
    "table{border-collapse:collapse;margin:1em 0}tr{border-bottom:1px solid #ddd}img{max-width:100%}"
    ".verdict{font-size:1.3em;padding:.6em;border-left:.4em solid}"
)


def write_page(file: Path, title: str, elements: Iterable[str]) -> Path:
    """Write a page of HTML elements under a title; return the file.

    Raises:
        OSError: If it cannot be written.
    """
    body = "\n".join(elements)
    file.write_text(
        "<!doctype html><html lang=en><meta charset=utf-8>"
        f"<meta name=viewport content='width=device-width'><title>{html.escape(title)}</title>"
        f"<style>{_STYLE}</style><h1>{html.escape(title)}</h1>\n{body}</html>\n",
        encoding="utf-8",
    )
    return file


def image_element(png: bytes, what: str) -> str:
    """Return a picture as an element, with what it shows for those who do not see it."""
    return f"<img alt='{html.escape(what, quote=True)}' src='data:image/png;base64,{base64.b64encode(png).decode()}'>"


def table_element(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as an element."""
    cells = "".join(f"<th>{html.escape(each)}</th>" for each in head)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(each)}</td>" for each in row) + "</tr>" for row in rows)
    return f"<table><tr>{cells}</tr>{body}</table>"


def list_element(items: Iterable[str]) -> str:
    """Return a list as an element."""
    return "<ul>" + "".join(f"<li>{html.escape(each)}</li>" for each in items) + "</ul>"
