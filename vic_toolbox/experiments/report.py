"""A report as one HTML file that needs nothing else: figures, films and style are inside it."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from string import Template
from typing import Any, Protocol

import vic_toolbox
from vic_toolbox.errors import FileError
from vic_toolbox.files import write_atomically

_PAGE = Path(__file__).parent / "report.html.template"


@dataclass(frozen=True)
class Figure:
    """A drawing (``.svg`` or ``.png``) with the sentence that says what to see in it."""

    path: Path
    title: str
    caption: str

    def html(self) -> str:
        """The element."""
        kind = "image/svg+xml" if self.path.suffix == ".svg" else "image/png"
        picture = f'<img alt="{escape(self.title, quote=True)}" src="{_embedded(self.path, kind)}">'
        return section(
            self.title, f"<figure>{picture}<figcaption>{escape(self.caption)}</figcaption></figure>"
        )


@dataclass(frozen=True)
class Film:
    """A film (``.mp4``)."""

    path: Path
    title: str
    caption: str

    def html(self) -> str:
        """The element."""
        source = _embedded(self.path, "video/mp4")
        toggle = "this.paused ? this.play() : this.pause()"
        attributes = f'loop muted autoplay playsinline title="click to pause" onclick="{toggle}"'
        film = f'<video {attributes} src="{source}"></video>'
        return section(self.title, f"<figure>{film}<figcaption>{escape(self.caption)}</figcaption></figure>")


@dataclass(frozen=True)
class Table:
    """Rows of text; the first column is left-aligned. A row may be set off as the one to look at."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    caption: str = ""
    marked: frozenset[int] = field(default_factory=frozenset)

    def html(self) -> str:
        """The element."""
        head = "".join(f"<th>{escape(cell)}</th>" for cell in self.head)
        rows = ("".join(f"<td>{escape(cell)}</td>" for cell in row) for row in self.rows)
        body = "".join(
            f"<tr{' class=marked' if i in self.marked else ''}>{row}</tr>" for i, row in enumerate(rows)
        )
        table = f"<div class=scroll><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
        return section(
            self.title, table + (f"<p class=caption>{escape(self.caption)}</p>" if self.caption else "")
        )


@dataclass(frozen=True)
class Note:
    """A paragraph."""

    text: str

    def html(self) -> str:
        """The element."""
        return f"<p class=note>{escape(self.text)}</p>"


@dataclass(frozen=True)
class Remedies:
    """Things to know, each with what to do about it: (kind, what, remedy), kind ``alarm``, ``warning`` or ``note``."""

    title: str
    items: Sequence[tuple[str, str, str]]

    def html(self) -> str:
        """The element."""
        items = "".join(
            f"<li class={escape(kind, quote=True)}>{escape(what)}"
            + (f"<span>{escape(remedy)}</span>" if remedy else "")
            + "</li>"
            for kind, what, remedy in self.items
        )
        return section(self.title, f"<ul class=remedies>{items}</ul>")


@dataclass(frozen=True)
class Commands:
    """What to type next: (command, what it does)."""

    title: str
    commands: Sequence[tuple[str, str]]

    def html(self) -> str:
        """The element."""
        items = "".join(
            f"<dt><code>{escape(line)}</code></dt><dd>{escape(what)}</dd>" for line, what in self.commands
        )
        return section(self.title, f"<dl class=commands>{items}</dl>")


@dataclass(frozen=True)
class Settings:
    """Every setting, folded away."""

    title: str
    values: Mapping[str, Any]

    def html(self) -> str:
        """The element."""
        rows = "".join(
            f"<tr><td><code>{escape(name)}</code></td><td><code>{escape(str(value))}</code></td></tr>"
            for name, value in self.values.items()
        )
        return (
            f"<details><summary>{escape(self.title)}</summary><table class=settings>{rows}</table></details>"
        )


class Part(Protocol):
    """What a page is put together from: those above, and whatever else writes itself."""

    def html(self) -> str:
        """The element."""
        ...


def write_report(
    path: Path,
    *,
    title: str,
    subtitle: str,
    summary: str,
    tiles: Sequence[tuple[str, str]] = (),
    parts: Sequence[Part],
    footer: str = "Scores are of the policy's mean action.",
) -> None:
    """Write the page.

    Parameters
    ----------
    path : Path
        The HTML file to write.
    title, subtitle, summary : str
        Head of the page; the summary is the result in one or two sentences.
    tiles : Sequence[tuple[str, str]]
        The few numbers that matter, each with what it is.
    parts : Sequence[Part]
        The rest of the page, in order.
    footer : str
        What all numbers of the page have in common.

    Raises
    ------
    FileError
        A figure is missing or the page cannot be written.
    """
    numbers = "".join(
        f"<div class=tile><b>{escape(n)}</b><span>{escape(what)}</span></div>" for n, what in tiles
    )
    page = Template(_PAGE.read_text(encoding="utf-8")).substitute(
        title=escape(title),
        subtitle=escape(subtitle),
        summary=escape(summary),
        tiles=f"<div class=tiles>{numbers}</div>" if tiles else "",
        body="\n".join(part.html() for part in parts),
        version=escape(vic_toolbox.__version__),
        footer=escape(footer),
    )
    write_atomically(path, page)


def section(title: str, content: str) -> str:
    """A part of the page under a heading; the content is HTML."""
    return f"<section><h2>{escape(title)}</h2>{content}</section>"


def _embedded(path: Path, kind: str) -> str:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(f"{path} cannot be read ({error}); draw it again.") from error
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
