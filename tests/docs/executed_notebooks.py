"""Notebooks, executed cell by cell in one namespace; as a program it draws the thumbnails of the gallery.

python -m tests.docs.executed_notebooks
"""

import ast
import json
import os
import tempfile
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
THUMBNAIL_WIDTH = 320
"""px"""


def cells(notebook: Path, kind: str = "code") -> list[str]:
    """Sources of a notebook's cells of one kind."""
    document = json.loads(notebook.read_text())
    return ["".join(cell["source"]) for cell in document["cells"] if cell["cell_type"] == kind]


def execute(notebook: Path) -> list[Any]:
    """What the cells display, run in the current folder: of each its last expression and its pyplot figures, as in Jupyter."""
    names: dict[str, Any] = {"__name__": "__main__"}
    shown: list[Any] = []
    for number, text in enumerate(cells(notebook), start=1):
        code = "\n".join(line for line in text.splitlines() if not line.startswith("%"))  # magics of Jupyter
        body, name = ast.parse(code).body, f"{notebook.name}, cell {number}"
        last = body[-1]
        is_shown = isinstance(last, ast.Expr) and not text.rstrip().endswith(";")
        statements = body[:-1] if is_shown else body
        exec(compile(ast.Module(statements, []), name, "exec"), names)
        if is_shown and isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), name, "eval"), names)
            if value is not None:
                shown.append(value)
        shown += [plt.figure(figure) for figure in plt.get_fignums()]
        plt.close("all")
    return shown


def main() -> None:
    """Draw the last figure of every notebook beside it."""
    for notebook in NOTEBOOKS:
        before = Path.cwd()
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            try:
                figures = [value for value in execute(notebook) if isinstance(value, Figure)]
            finally:
                os.chdir(before)
        width = figures[-1].get_size_inches()[0]
        figures[-1].savefig(notebook.with_suffix(".png"), dpi=THUMBNAIL_WIDTH / width)


if __name__ == "__main__":
    main()
