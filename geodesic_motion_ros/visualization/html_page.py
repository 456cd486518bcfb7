"""Pieces of an HTML page that needs no network and no script, for a screen, light or dark, and for paper."""

from __future__ import annotations

import base64
import html
from collections.abc import Iterable, Mapping, Sequence

from geodesic_motion_ros.utils.tables import Cell, shown_cell

_STYLE = """\
:root { color-scheme: light dark; --ink: #1c2430; --soft: #5b6675; --line: #d8dde4; --page: #ffffff; --card: #f4f6f9;
  --mark: #0072b2; --bad: #b34700; }
@media (prefers-color-scheme: dark) { :root { --ink: #e4e8ee; --soft: #9aa5b4; --line: #38414e; --page: #14181e;
  --card: #1d232c; --mark: #6cb8e6; --bad: #f0a05a; } }
body { margin: 0 auto; max-width: 62rem; padding: 1.5rem 1.2rem 4rem; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, sans-serif; }
h1 { margin: 0 0 .2rem; font-size: 1.9rem; overflow-wrap: anywhere; }
h2 { margin: 2.6rem 0 .6rem; padding-top: .8rem; border-top: 1px solid var(--line); font-size: 1.3rem; }
h3 { margin: 1.4rem 0 .4rem; font-size: 1rem; }
p { margin: .4rem 0; max-width: 48rem; }
.soft, figcaption, th { color: var(--soft); }
.bad { color: var(--bad); }
nav a { margin-right: 1rem; color: var(--mark); white-space: nowrap; }
.cards { display: flex; flex-wrap: wrap; gap: .7rem; margin: 1rem 0; }
.cards div { flex: 1 1 7rem; padding: .6rem .8rem; border-radius: .5rem; background: var(--card); font-size: .85rem; }
.cards b { display: block; font-size: 1.35rem; }
.scroll { overflow-x: auto; }
table { margin: .6rem 0; border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .25rem .9rem .25rem 0; border-bottom: 1px solid var(--line); text-align: left; vertical-align: top; }
th { font-weight: 500; }
.columns { columns: 19rem; column-gap: 2rem; }
.columns p { display: flex; justify-content: space-between; gap: 1rem; margin: 0; border-bottom: 1px solid var(--line);
  font-size: .85rem; break-inside: avoid; overflow-wrap: anywhere; }
figure { margin: .8rem 0; break-inside: avoid; }
figure img { max-width: 100%; height: auto; border-radius: .4rem; background: #fff; }
figcaption { font-size: .85rem; }
code { padding: 0 .25rem; border-radius: .25rem; background: var(--card); font-size: .88em; overflow-wrap: anywhere; }
@media print { :root { --ink: #000; --soft: #444; --line: #bbb; --page: #fff; --card: #f2f2f2; --mark: #000;
  --bad: #803300; } body { max-width: none; padding: 0; font-size: 10.5pt; } nav { display: none; }
  h2, h3 { break-after: avoid; } tr { break-inside: avoid; } }
"""


def page(title: str, top: str, sections: Sequence[tuple[str, str, str]]) -> str:
    """A page: what stands at the top, links to the sections, and the sections, each (anchor, title, content)."""
    links = "".join(f'<a href="#{anchor}">{escaped(name)}</a>\n' for anchor, name, _ in sections)
    body = "".join(
        f'<section id="{anchor}">\n<h2>{escaped(name)}</h2>\n{content}</section>\n'
        for anchor, name, content in sections
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{html.escape(title)}</title>\n<style>\n{_STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{html.escape(title)}</h1>\n{top}<nav>\n{links}</nav>\n{body}</body>\n</html>\n"
    )


def cards(figures: Iterable[tuple[str, str]]) -> str:
    """Figures in large letters, each with what it is of."""
    shown = "".join(f"<div><b>{escaped(figure)}</b>{escaped(text)}</div>\n" for figure, text in figures)
    return f'<div class="cards">\n{shown}</div>\n'


def listed(values: Mapping[str, str]) -> str:
    """Names with their values, in as many columns as there is room for."""
    pairs = ((escaped(name), escaped(text)) for name, text in values.items())
    lines = "".join(f"<p><span>{name}</span><span>{text}</span></p>\n" for name, text in pairs)
    return f'<div class="columns">\n{lines}</div>\n'


def heading(text: str) -> str:
    """Of a part of a section."""
    return f"<h3>{escaped(text)}</h3>\n"


def escaped(text: str) -> str:
    """Text for HTML; what stands between backticks is code."""
    parts = html.escape(text).split("`")
    return "".join(f"<code>{part}</code>" if number % 2 else part for number, part in enumerate(parts))


def note(text: str, kind: str = "") -> str:
    """A paragraph; kind : "soft" or "bad"."""
    named = f' class="{kind}"' if kind else ""
    return f"<p{named}>{escaped(text)}</p>\n"


def table(head: Sequence[str], rows: Iterable[Sequence[Cell]], digits: int = 2) -> str:
    """Rows under a head; without one the first column names its row."""
    top = "".join(f'<th scope="col">{escaped(name)}</th>' for name in head)
    lines = []
    for row in rows:
        texts = [escaped(shown_cell(cell, digits)) for cell in row]
        first = f'<th scope="row">{texts[0]}</th>' if not head else f"<td>{texts[0]}</td>"
        lines.append(f"<tr>{first}{''.join(f'<td>{text}</td>' for text in texts[1:])}</tr>\n")
    above = f"<thead><tr>{top}</tr></thead>\n" if head else ""
    return f'<div class="scroll"><table>\n{above}<tbody>\n{"".join(lines)}</tbody>\n</table></div>\n'


def figure(picture: bytes, caption: str) -> str:
    """A PNG of 150 pixels an inch with a caption under it, shown with 100 an inch where there is room."""
    width = int.from_bytes(picture[16:20], "big") * 2 // 3  # of the first chunk of a PNG
    data = base64.b64encode(picture).decode()
    shown = f'<img alt="{html.escape(caption)}" width="{width}" src="data:image/png;base64,{data}">'
    return f"<figure>\n{shown}\n<figcaption>{escaped(caption)}</figcaption>\n</figure>\n"
