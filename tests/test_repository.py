"""Promises of the repository: versions agree, layers are complete, no data becomes code."""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from setuptools import find_packages

import spinfilters

ROOT = Path(__file__).parents[1]
PACKAGES = [name for name in ("spinfilters", "observability", "experiments") if (ROOT / name).is_dir()]
SOURCES = [path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))]
FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve"}
FORBIDDEN_CALLS = {"eval", "exec", "yaml.load", "yaml.unsafe_load", "yaml.full_load", "os.system"}
SUSPICIOUS = re.compile(rf"\b(eval|exec)\s*\(|{'|'.join(sorted(FORBIDDEN_MODULES))}|yaml|system|shell")
"""Without any of these a source text has nothing of both, and need not be taken apart."""


def pyproject() -> dict[str, Any]:
    """The build file."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def layers() -> set[str]:
    """Modules that the contract of import-linter puts in a layer."""
    rows = pyproject()["tool"]["importlinter"]["contracts"][0]["layers"]
    return {module.strip() for row in rows for module in re.split("[|:]", row)}


def unsafe(text: str) -> Iterator[str]:
    """What a source text imports or calls that could run code out of data."""
    if not SUSPICIOUS.search(text):
        return
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.split(".")[0] in FORBIDDEN_MODULES)
        elif isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (name for name in names if name.split(".")[0] in FORBIDDEN_MODULES)
            yield from (name for name in names if name in FORBIDDEN_CALLS)
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            settings = {(argument.arg, ast.unparse(argument.value)) for argument in node.keywords}
            if called in FORBIDDEN_CALLS or settings & {("allow_pickle", "True"), ("shell", "True")}:
                yield called


def test_the_version_of_the_package_is_that_of_the_build_file() -> None:
    assert spinfilters.__version__ == pyproject()["project"]["version"]


def test_the_source_distribution_has_every_file_of_the_tree(tmp_path: Path) -> None:
    """Its tests run from it alone. Files that are built, or made by running, are no part of it."""
    command = [sys.executable, "-c", "import setuptools; setuptools.setup()", "-q", "egg_info"]
    subprocess.run([*command, "--egg-base", str(tmp_path)], cwd=ROOT, check=True, capture_output=True)
    listed = (tmp_path / "spinfilters.egg-info" / "SOURCES.txt").read_text().splitlines()
    folders = ("spinfilters", "observability", "experiments", "tests", "docs", ".ci", ".github")
    found = [path for name in folders for path in (ROOT / name).rglob("*") if path.is_file()]
    wanted = {str(path.relative_to(ROOT)) for path in found if path.suffix not in {".pyc", ".so"}}
    wanted |= {path.name for path in ROOT.glob("*.md")} | {
        "Makefile",
        "LICENSE",
        ".mkdocs.yml",
        "MANIFEST.in",
    }
    assert wanted <= set(listed)
    assert not [name for name in listed if name.endswith((".pyc", ".so"))]


def test_every_package_module_and_folder_stands_in_a_layer() -> None:
    parts = {
        f"spinfilters.{path.stem}"
        for path in (ROOT / "spinfilters").iterdir()
        if path.suffix == ".py" or (path / "__init__.py").exists()
    } - {"spinfilters.__init__", "spinfilters.__main__"}
    others = set(PACKAGES) - {"spinfilters"}
    assert parts | others == layers()
    assert set(PACKAGES) == set(pyproject()["tool"]["importlinter"]["root_packages"])


def doubled(places: Iterable[tuple[str, str]]) -> dict[str, list[str]]:
    """Names that stand at more than one place, with their places."""
    found: dict[str, list[str]] = {}
    for name, place in places:
        found.setdefault(name, []).append(place)
    return {name: at for name, at in found.items() if len(at) > 1}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_module_name_stands_once_in_a_package(package: str) -> None:
    modules = [path for path in (ROOT / package).rglob("*.py") if not path.stem.startswith("__")]
    assert doubled((path.stem, str(path.relative_to(ROOT))) for path in modules) == {}


def classes_of(path: Path) -> list[str]:
    """Names of the classes that a source defines."""
    return re.findall(r"^ *class (\w+) *[(:\[]", path.read_text(), re.MULTILINE)


def test_a_class_name_stands_once_in_the_tree() -> None:
    places = [(name, str(path.relative_to(ROOT))) for path in SOURCES for name in classes_of(path)]
    assert doubled(places) == {}


def test_a_name_at_two_places_is_found() -> None:
    assert doubled([("a", "x"), ("b", "y"), ("a", "z")]) == {"a": ["x", "z"]}


NUMBERS = {"int", "float"}


def packed_arguments(text: str) -> list[str]:
    """Arguments of a source text that are tuples of several things; of numbers of one kind they are places and sizes."""
    if "tuple[" not in text:
        return []
    functions = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
    arguments = [each for node in functions for each in (*node.args.args, *node.args.kwonlyargs)]
    inside = [(each.arg, part) for each in arguments if each.annotation for part in ast.walk(each.annotation)]
    tuples = [
        (name, part.slice)
        for name, part in inside
        if isinstance(part, ast.Subscript) and ast.unparse(part.value) == "tuple"
    ]
    kinds = [
        (name, {ast.unparse(each) for each in of.elts}) for name, of in tuples if isinstance(of, ast.Tuple)
    ]
    return [
        name for name, kind in kinds if "..." not in kind and not any(kind == {number} for number in NUMBERS)
    ]


def test_what_belongs_together_has_names() -> None:
    found = {str(path.relative_to(ROOT)): packed_arguments(path.read_text()) for path in SOURCES}
    assert {path: names for path, names in found.items() if names} == {}


def test_a_packed_argument_is_found_and_a_size_is_none() -> None:
    assert packed_arguments("def f(a: list[tuple[int, str]], b: tuple[A, A] | None) -> None: ...") == [
        "a",
        "b",
    ]
    assert packed_arguments("def f(a: tuple[int, int], b: tuple[str, ...]) -> tuple[int, str]: ...") == []


def test_no_file_of_the_packages_can_run_code_out_of_data() -> None:
    found = {str(path.relative_to(ROOT)): list(unsafe(path.read_text())) for path in SOURCES}
    assert {path: names for path, names in found.items() if names} == {}


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "from pickle import loads",
        "eval('1')",
        "import yaml\nyaml.load(stream, Loader=yaml.Loader)",
        "np.load(path, allow_pickle=True)",
        "subprocess.run(line, shell=True)",
    ],
)
def test_the_search_for_such_code_finds_it(text: str) -> None:
    assert list(unsafe(text))


def test_safe_look_alikes_are_not_reported() -> None:
    assert list(unsafe("yaml.safe_load(stream)\nmodel.eval()\nnp.load(path, allow_pickle=False)")) == []


def is_experiment(path: Path) -> bool:
    """Whether a source is of the experiments, which run from a checkout and are not installed."""
    return path.relative_to(ROOT).parts[0] == "experiments"


def test_what_is_built_holds_the_packages_and_neither_tests_experiments_nor_runs() -> None:
    found = find_packages(str(ROOT), include=pyproject()["tool"]["setuptools"]["packages"]["find"]["include"])
    assert {name.split(".")[0] for name in found} == {"spinfilters", "observability"}
    folders = {".".join(path.parent.relative_to(ROOT).parts) for path in SOURCES if not is_experiment(path)}
    assert set(found) == folders, "a folder of sources without __init__.py is missing from the wheel"


def test_every_make_command_of_the_readme_exists_and_the_two_first_ones_are_shown() -> None:
    shown = set(re.findall(r"\bmake ([a-z-]+)", "\n".join(code_of((ROOT / "README.md").read_text()))))
    assert {"compare", "test"} <= shown
    assert shown <= targets()


def test_everything_that_the_makefile_says_of_itself_is_a_target() -> None:
    head = (ROOT / "Makefile").read_text().partition("\n\n")[0]
    assert set(re.findall(r"\bmake ([a-z-]+)", head)) == targets()


BLOB = "https://github.com/spinfilters/spinfilters/blob/main/"


def links_of(markdown: str) -> list[str]:
    """Targets of the links and pictures of a page."""
    return re.findall(r"\]\(([^)\s]+)\)", markdown)


def test_links_of_the_readme_work_on_a_package_index() -> None:
    """An index shows the page without the repository: a relative link leads nowhere there."""
    links = links_of((ROOT / "README.md").read_text())
    assert [link for link in links if not link.startswith("https://")] == []
    own = [link.removeprefix(BLOB).partition("#")[0] for link in links if link.startswith(BLOB)]
    assert len(own) > 30
    assert [path for path in own if not (ROOT / path).is_file()] == []


def test_a_relative_link_is_found() -> None:
    assert links_of("see [this](docs/a.md#b) and ![that](https://x/y.png)") == [
        "docs/a.md#b",
        "https://x/y.png",
    ]


def code_of(markdown: str) -> list[str]:
    """Fenced blocks and inline code of a page."""
    fenced = re.findall(r"^```[^\n]*\n(.*?)^```", markdown, re.MULTILINE | re.DOTALL)
    return fenced + re.findall(r"`([^`\n]+)`", markdown)


def targets() -> set[str]:
    """Targets of the Makefile that are commands."""
    (line,) = re.findall(r"^\.PHONY:(.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    return set(line.split())


LOADERS = {"compiled", "c_library", "vectorised"}
"""Modules of `core` that load compiled code, or do without."""
LOAD_FOR_A_USER = {"cli", "embedded"}
"""Rooms that load what a user asked for; their tests build it."""


def rooms_with_compiled_code() -> set[str]:
    """Rooms of the package, and the analyser, with a module that takes a function from a loader."""
    imported = re.compile(rf"^\s*from spinfilters\.core\.({'|'.join(sorted(LOADERS))}) import ", re.MULTILINE)
    found = {path.relative_to(ROOT).parts for path in SOURCES if imported.search(path.read_text())}
    return {
        parts[1] if parts[0] == "spinfilters" else parts[0] for parts in found if parts[0] != "experiments"
    }


@pytest.mark.skipif(shutil.which("make") is None, reason="make is not installed")
def test_every_room_with_compiled_code_is_tested_without_it() -> None:
    """Whole recordings are left to compiled code; the other files of their rooms must be there."""
    program = "listed: ; @echo $(interpreted) ; echo $(whole)"
    command = ["make", "--no-print-directory", "--eval", program, "listed"]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    interpreted, whole = (line.split() for line in done.stdout.splitlines())
    rooms = rooms_with_compiled_code()
    assert {"core", "filters", "smoother", "models", "observability"} <= rooms
    assert rooms - LOAD_FOR_A_USER <= {Path(name).parts[1] for name in interpreted}
    assert whole
    assert all((ROOT / name).is_file() for name in (*interpreted, *whole))
    assert not set(whole) & set(interpreted)


def test_files_that_are_read_at_run_time_are_built_in() -> None:
    """C texts lie beside the modules that compile them; a wheel holds them only where the build file says so."""
    data = pyproject()["tool"]["setuptools"]["package-data"]
    texts = [path for name in PACKAGES for path in (ROOT / name).rglob("*.[ch]")]
    assert texts
    for path in texts:
        package = ".".join(path.relative_to(ROOT).parent.parts)
        assert any(path.match(pattern) for pattern in data.get(package, [])), f"{path.name} is not in a wheel"


def test_a_name_of_a_test_file_stands_once() -> None:
    """Folders of tests are no packages: of two files of one name only the first is collected."""
    files = sorted((ROOT / "tests").rglob("test_*.py"))
    assert doubled((path.name, str(path.relative_to(ROOT))) for path in files) == {}
