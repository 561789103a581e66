"""Self-contained HTML page.

Nothing is loaded from anywhere, and every text that is not HTML is escaped.
"""

import base64
import hashlib
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

STYLE: Final = """
:root{color-scheme:light}body{font:15px/1.5 system-ui,sans-serif;color:#1d2328;max-width:1400px;margin:2rem auto;padding:0 1.2rem}
h1{font-size:1.6rem;margin-bottom:.2rem}h2{font-size:1.2rem;margin-top:2.2rem;border-bottom:1px solid #d5dade;padding-bottom:.2rem}
table{border-collapse:collapse;font-size:.86rem;font-variant-numeric:tabular-nums;margin:.6rem 0}
th,td{padding:.22rem .6rem;border-bottom:1px solid #e4e8eb;text-align:right;white-space:nowrap}
th:first-child,td:first-child{text-align:left}thead th{border-bottom:2px solid #9aa5ad;vertical-align:bottom}
.i{color:#66717a;font-size:.9em}.bad{color:#b23b00;font-weight:600}.scroll{overflow-x:auto}img{max-width:100%;height:auto}
pre,code{font:.83rem/1.45 ui-monospace,monospace;background:#f4f6f7;border-radius:4px}pre{padding:.7rem;overflow-x:auto}
table.facts td{text-align:left;white-space:normal}
code{padding:.1rem .3rem}details{margin:.15rem 0}summary{cursor:pointer}p.note{color:#55606a;max-width:80ch}
figure{margin:1rem 0}figcaption{color:#55606a;max-width:80ch}
canvas{background:#14181c;border-radius:4px;max-width:100%;touch-action:none}
"""


def page(parts: Mapping[str, str], title: str, script: str = "") -> str:
    """HTML of sections by their headings; sections are HTML already.

    Parameters
    ----------
    script: the only one that a browser runs on the page; its hash stands in the page's policy.
    """
    body = "".join(f"<section><h2>{escape(head)}</h2>{inner}</section>" for head, inner in parts.items())
    policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
    if script:
        digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
        policy += f"; script-src 'sha256-{digest}'"
        body += f"<script>{script}</script>"
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        f'<meta name="viewport" content="width=device-width"><style>{STYLE}</style></head>'
        f"<body><h1>{escape(title)}</h1>{body}</body></html>\n"
    )


def image(data: bytes, words: str, kind: str = "png") -> str:
    """A picture within the page."""
    return (
        f'<p><img alt="{escape(words)}" src="data:image/{kind};base64,{base64.b64encode(data).decode()}"></p>'
    )


def facts(told: Mapping[str, str]) -> str:
    """Table of names with their values."""
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in told.items()
    )
    return f'<table class="facts"><tbody>{rows}</tbody></table>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]], words: int) -> str:
    """A table of cells that are HTML already; the first ``words`` columns are text."""
    left = ' style="text-align:left"'
    top = "".join(f"<th{left if k < words else ''}>{escape(name)}</th>" for k, name in enumerate(head))
    body = "".join(
        "<tr>"
        + "".join(f"<td{left if k < words else ''}>{cell}</td>" for k, cell in enumerate(row))
        + "</tr>"
        for row in rows
    )
    return f'<div class="scroll"><table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table></div>'


def details(words: str, text: str) -> str:
    """Collapsible text."""
    return f"<details><summary>{escape(words)}</summary><pre>{escape(text)}</pre></details>"


def note(text: str) -> str:
    """A remark."""
    return f'<p class="note">{escape(text)}</p>'
