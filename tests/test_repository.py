"""Promises of the repository: versions agree, layers are complete, files are small, no data becomes code."""

import ast
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from setuptools import find_packages

import spinfilters

ROOT = Path(__file__).parents[1]
LONGEST_FILE = 300
MOST_WORDS = 16
FIRST_LINE = re.compile(r'(?:\A|:\n)[ \t]*r?"""(.*?)(?:"""|$)', re.MULTILINE)
PACKAGES = [name for name in ("spinfilters", "observability", "experiments") if (ROOT / name).is_dir()]
SOURCES = [path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))]
FORBIDDEN_MODULES = {"pickle", "cPickle", "dill", "joblib", "marshal", "shelve"}
FORBIDDEN_CALLS = {"eval", "exec", "yaml.load", "yaml.unsafe_load", "yaml.full_load", "os.system"}


def pyproject() -> dict[str, Any]:
    """The build file."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


def layers() -> set[str]:
    """Modules that the contract of import-linter puts in a layer."""
    rows = pyproject()["tool"]["importlinter"]["contracts"][0]["layers"]
    return {module.strip() for row in rows for module in re.split("[|:]", row)}


def unsafe(text: str) -> Iterator[str]:
    """What a source text imports or calls that could run code out of data."""
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


def test_every_package_module_and_folder_stands_in_a_layer() -> None:
    parts = {
        f"spinfilters.{path.stem}"
        for path in (ROOT / "spinfilters").iterdir()
        if path.suffix == ".py" or (path / "__init__.py").exists()
    } - {"spinfilters.__init__", "spinfilters.__main__"}
    others = set(PACKAGES) - {"spinfilters"}
    assert parts | others == layers()
    assert set(PACKAGES) == set(pyproject()["tool"]["importlinter"]["root_packages"])


def test_a_file_is_short_enough_to_be_one_noun() -> None:
    lines = {str(path.relative_to(ROOT)): len(path.read_text().splitlines()) for path in SOURCES}
    assert {path: count for path, count in lines.items() if count > LONGEST_FILE} == {}


def wordy(text: str) -> list[str]:
    """First docstring lines of a source text that have too many words."""
    return [line for line in FIRST_LINE.findall(text) if len(line.split()) > MOST_WORDS]


def test_a_docstring_begins_with_a_short_line() -> None:
    found = {str(path.relative_to(ROOT)): wordy(path.read_text()) for path in SOURCES}
    assert {path: lines for path, lines in found.items() if lines} == {}


def test_a_long_first_line_is_found_in_modules_functions_and_classes() -> None:
    line = " ".join(["word"] * (MOST_WORDS + 1))
    text = f'"""{line}"""\n\nclass A:\n    """{line}\n    """\n\n    def b(\n        self,\n    ) -> None:\n        r"""{line}"""\n'
    assert wordy(text) == [line] * 3


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


def code_of(markdown: str) -> list[str]:
    """Fenced blocks and inline code of a page."""
    fenced = re.findall(r"^```[^\n]*\n(.*?)^```", markdown, re.MULTILINE | re.DOTALL)
    return fenced + re.findall(r"`([^`\n]+)`", markdown)


def targets() -> set[str]:
    """Targets of the Makefile that are commands."""
    (line,) = re.findall(r"^\.PHONY:(.*)$", (ROOT / "Makefile").read_text(), re.MULTILINE)
    return set(line.split())


def test_files_that_are_read_at_run_time_are_built_in() -> None:
    """C texts lie beside the modules that compile them; a wheel holds them only where the build file says so."""
    data = pyproject()["tool"]["setuptools"]["package-data"]
    texts = [path for name in PACKAGES for path in (ROOT / name).rglob("*.[ch]")]
    assert texts
    for path in texts:
        package = ".".join(path.relative_to(ROOT).parent.parts)
        assert any(path.match(pattern) for pattern in data.get(package, [])), f"{path.name} is not in a wheel"
