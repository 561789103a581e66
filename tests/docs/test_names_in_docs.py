"""Names that docs and docstrings give exist: packages, modules, classes, extras, state blocks."""

import ast
import re
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules

import pytest

import spinfilters
from spinfilters.core import conventions
from spinfilters.models.state_blocks import BLOCKS

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
SOURCES = [path for room in ("spinfilters", "observability") for path in sorted((ROOT / room).rglob("*.py"))]
REFERENCE = re.compile(r"`(spinfilters(?:\.\w+)+)`")


def _docstrings(path: Path) -> str:
    kinds = (ast.Module, ast.ClassDef, ast.FunctionDef)
    nodes = (node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, kinds))
    return "\n".join(ast.get_docstring(node) or "" for node in nodes)


def _entry_point_groups() -> set[str]:
    """Groups that plug-ins register with: names of no module."""
    code = "\n".join(path.read_text() for path in SOURCES)
    asked = r'(?:group=|installed_plugins\(|members_above\()\s*"(spinfilters\.\w+)"'
    return set(re.findall(asked, code))


def _exists(name: str) -> bool:
    """Whether a dotted name is a module, or an attribute of one."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: object = import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        for part in parts[length:]:
            if not hasattr(found, part) and part not in getattr(found, "__annotations__", {}):
                return False
            found = getattr(found, part, None)
        return True
    return False


def test_a_dotted_name_in_a_docstring_or_a_page_exists() -> None:
    texts = {path: _docstrings(path) for path in SOURCES} | {path: path.read_text() for path in PAGES}
    named = {(name, path.name) for path, text in texts.items() for name in REFERENCE.findall(text)}
    names = {name for name, _ in named}
    assert len(names) > 20
    missing = {name for name in names if not _exists(name)} - _entry_point_groups()
    assert not {each for each in named if each[0] in missing}


def test_the_map_of_the_package_names_every_package_and_no_other() -> None:
    page = (ROOT / "docs" / "reference" / "packages.md").read_text()
    cells = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    named = {name for cell in cells for name in re.findall(r"`(?:spinfilters)?\.(\w+)(?:\.\w+)*`", cell)}
    packages = {module.name for module in iter_modules(spinfilters.__path__) if module.ispkg}
    assert named == packages


@pytest.mark.parametrize("block", BLOCKS.values(), ids=lambda block: block.name)
def test_the_conventions_name_every_state_block_with_its_dimension(block: object) -> None:
    name, dimension = block.name, block.dimension  # pyright: ignore[reportAttributeAccessIssue]
    assert f"``{name}`` {dimension}  " in (conventions.__doc__ or "")
