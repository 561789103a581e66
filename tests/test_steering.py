"""Nothing steers by a type or by the name of a sensor outside the registries."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("spinfilters", "observability", "experiments")
SOURCES = [path for name in PACKAGES for path in sorted((ROOT / name).rglob("*.py"))]
SENSOR_NAMES = {"gyro", "pose", "attitude", "stereo", "monocular", "lidar", "lidar-points", "lidar-poses"}
FOREIGN_VALUES = {
    "api": "arguments of a user",
    "campaigns": "a user's study, rows of a file",
    "cli": "arguments of a user",
    "io": "files",
    "live": "errors of sockets",
    "core/plugins.py": "plug-ins",
    "settings": "files",
}
"""Rooms of spinfilters that are handed values of any type, and which: they ask for types because nobody else has."""
VALIDATED = {
    "spinfilters/core/attitude_conversions.py": "an expression gives one matrix or several",
    "spinfilters/core/c_library.py": "errors of a compiler",
    "spinfilters/core/compiled.py": "arrays or numbers for buffers",
    "spinfilters/filters/timeline.py": "an index is a number or a slice",
    "spinfilters/lidar/scan.py": "a file, and its times",
    "spinfilters/reproduction/results.py": "files of an earlier call",
    "spinfilters/run/array_files.py": "files of a run",
    "spinfilters/run/checkpoints.py": "files of a run",
    "spinfilters/run/conditions.py": "a file",
    "spinfilters/run/reference_output.py": "a recording or its path, of a user",
    "spinfilters/run/run_folder.py": "fields of a data set",
    "spinfilters/run/run_summary.py": "files of a run",
    "spinfilters/run/reconstruction.py": "a key of a file",
    "spinfilters/vision/rectification.py": "a file",
    "spinfilters/vision/association.py": "arrays among attributes",
    "observability/exact_numbers.py": "numbers of a user",
    "observability/bound_section.py": "tables of a user's file",
    "observability/model.py": "a user's model",
    "observability/model_text.py": "numbers of a user's model",
}
"""Other files that do, and what of."""


HANDED_IN = {"Dataset", "InputError", "Model", "Sensor", "Settings"}
"""Classes of ours that are asked for there: what a user may hand in, and what was raised."""


def conditions(text: str) -> Iterator[ast.AST]:
    """Nodes of a source text that can steer: all but what an ``assert`` holds."""
    waiting: list[ast.AST] = [ast.parse(text)]
    while waiting:
        node = waiting.pop()
        if not isinstance(node, ast.Assert):
            yield node
            waiting += ast.iter_child_nodes(node)


def type_tests(text: str) -> list[str]:
    """What a source text asks for its type."""
    if "isinstance(" not in text and "issubclass(" not in text:
        return []
    asked = [node for node in conditions(text) if isinstance(node, ast.Call)]
    return [ast.unparse(node) for node in asked if ast.unparse(node.func) in ("isinstance", "issubclass")]


def name_tests(text: str) -> list[str]:
    """Comparisons of a source text with the name of a sensor."""
    if not any(f'"{name}"' in text or f"'{name}'" in text for name in SENSOR_NAMES):
        return []
    compared = [node for node in conditions(text) if isinstance(node, ast.Compare)]
    return [
        ast.unparse(node)
        for node in compared
        for side in (node.left, *node.comparators)
        if {each.value for each in ast.walk(side) if isinstance(each, ast.Constant)} & SENSOR_NAMES
    ]


def is_handed_foreign_values(path: Path) -> bool:
    """Whether a source stands at an edge."""
    place = path.relative_to(ROOT)
    name, *rest = place.parts
    edges = name == "spinfilters" and {rest[0], "/".join(rest)} & FOREIGN_VALUES.keys()
    return bool(edges) or str(place) in VALIDATED


def own_classes() -> set[str]:
    """Names of all classes of the tree."""
    return {
        name for path in SOURCES for name in re.findall(r"^ *class (\w+)", path.read_text(), re.MULTILINE)
    }


def test_no_name_of_a_sensor_steers() -> None:
    found = {str(path.relative_to(ROOT)): name_tests(path.read_text()) for path in SOURCES}
    assert {path: tests for path, tests in found.items() if tests} == {}


def test_no_type_steers() -> None:
    """What an object can do it says itself; only where values come from outside does anybody look at their type."""
    ours = own_classes() - HANDED_IN
    found = {}
    for path in SOURCES:
        tests = type_tests(path.read_text())
        if is_handed_foreign_values(path):
            tests = [each for each in tests if ours & set(re.findall(r"\w+", each))]
        found[str(path.relative_to(ROOT))] = tests
    assert {path: tests for path, tests in found.items() if tests} == {}


def test_every_file_that_may_look_at_types_does() -> None:
    assert [path for path in VALIDATED if not type_tests((ROOT / path).read_text())] == []


@pytest.mark.parametrize(
    "text", ["f(sensor == 'gyro')", "x = 1 if 'pose' in sensors else 2", "name not in ('stereo', 'pose')"]
)
def test_a_comparison_with_the_name_of_a_sensor_is_found(text: str) -> None:
    assert name_tests(text)


def test_a_type_that_steers_is_found_and_one_that_is_required_is_not() -> None:
    assert type_tests("if isinstance(sensor, Gyro):\n    pass") == ["isinstance(sensor, Gyro)"]
    assert type_tests("assert isinstance(sensor, Gyro)") == []
