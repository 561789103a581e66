"""Sentences of raised messages read as one line: no broken wraps, no doubled or missing spaces."""

import ast
import re
import tokenize
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).parents[1]
SOURCES = [path for room in ("spinfilters", "observability") for path in sorted((ROOT / room).rglob("*.py"))]
VALUE = "{}"
ODD = re.compile(r"\n|\t|  | [,;.!](?:\s|$)|[a-z]- [a-z]|^\s|\s$")
"""Line break, doubled space, space before punctuation, a word that was hyphenated to be wrapped, space at an end."""


def _literal(node: ast.AST) -> str | None:
    """Text of a literal, with `VALUE` in the place of values; None of anything else."""
    if isinstance(node, ast.Constant):
        return node.value if isinstance(node.value, str) else None
    if isinstance(node, ast.JoinedStr):
        return "".join(str(v.value) if isinstance(v, ast.Constant) else VALUE for v in node.values)
    return None


def _raised(path: Path) -> list[tuple[int, str]]:
    """Line and text of every literal that an exception is raised with."""
    calls = (node.exc for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Raise))
    told = (each for call in calls if isinstance(call, ast.Call) for each in call.args)
    found = ((each.lineno, _literal(each)) for each in told)
    return [(line, text) for line, text in found if text is not None]


def _joins(path: Path) -> list[tuple[int, str, str]]:
    """Pieces of literals that stand on lines of their own: the end of each and the begin of the next."""
    with path.open() as lines:
        tokens = [
            each
            for each in tokenize.generate_tokens(lines.readline)
            if each.type not in (tokenize.NL, tokenize.COMMENT)
        ]
    return [
        (one.start[0], one.string[1:-1][-20:], re.sub(r"^[rbf]*[\"']", "", other.string)[:20])
        for one, other in pairwise(tokens)
        if one.type == other.type == tokenize.STRING and one.end[0] < other.start[0]
    ]


def test_no_raised_message_has_an_odd_space_or_line_break() -> None:
    messages = [(path.name, line, text) for path in SOURCES for line, text in _raised(path)]
    assert len(messages) > 300
    assert not [each for each in messages if ODD.search(each[2])]


def test_no_two_words_run_together_where_a_literal_is_wrapped() -> None:
    joins = [(path.name, *each) for path in SOURCES for each in _joins(path)]
    assert len(joins) > 100
    together = [each for each in joins if re.search(r"[\w,;:)}]$", each[2]) and re.match(r"[\w({]", each[3])]
    assert not [each for each in together if not each[2].endswith("\\n")]
