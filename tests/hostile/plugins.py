"""Installed plug-ins that cannot be imported, are something else, have another's name, or fail when they are used.

python -m tests.hostile.plugins [--only TEXT] [--verbose]
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

from .campaign import campaign, parser
from .case import COMPARE, Case
from .changes import Change

MODULE = "stranger"
KINDS = {
    "sensors": "Sensor",
    "estimators": "EstimatorEntry",
    "readers": "DatasetReader",
    "front_ends": "RawDataReader",
    "metrics": "Metric",
    "figures": "FigureEntry",
}
"""Groups of entry points, and the class that each asks for."""
UNUSABLE = {
    "a module that is missing": None,
    "a syntax error": "ENTRY = (\n",
    "a null byte": "ENTRY = 1\0\n",
    "no such name": "OTHER = 1\n",
    "an error without text": "raise ValueError\n",
    "an error of many lines": "raise ValueError('a\\nb\\x1b[2J' * 5000)\n",
    "an error whose text fails": "class E(Exception):\n    def __str__(self):\n        return 1 / 0\nraise E\n",
    "no end of recursion": "def f():\n    return f()\nf()\n",
    "no memory": "raise MemoryError\n",
    "a missing library": "import no_such_library\n",
    "a missing file": "open('/no/such/file')\n",
    "an exit": "import sys\nsys.exit('good bye')\n",
    "an exit without error": "raise SystemExit(0)\n",
    "an error that is no exception": "raise GeneratorExit\n",
    "a number": "ENTRY = 3\n",
    "None": "ENTRY = None\n",
    "a class of its own": "class ENTRY:\n    name = 'x'\n",
    "a module": "import os as ENTRY\n",
    "what refuses every attribute": "class A:\n    def __getattribute__(self, _):\n        raise OSError\nENTRY = A()\n",
}
"""Texts of modules, of which no entry can be had."""
ESTIMATOR = """
from spinfilters.inference.estimator_entry import EstimatorEntry
class Entry(EstimatorEntry):
    name = "mine"
    {attributes}
    def build(self, setup, settings):
        {build}
ENTRY = Entry()
"""
READER = """
from spinfilters.io.dataset_reader import DatasetReader
class Reader(DatasetReader):
    name, words, order = "mine", "a file of mine", -1
    {attributes}
    def recognises(self, path):
        {recognises}
    def read(self, path, segment):
        {read}
ENTRY = Reader()
"""
FIGURE = """
from spinfilters.plots.figures import FigureEntry
class Drawn(FigureEntry):
    name, caption, order = "mine", "Mine.", 50
    {attributes}
    def draw(self, shown, name):
        {draw}
ENTRY = Drawn()
"""
METRIC = """
from spinfilters.evaluation.metrics import Metric
def value(span):
    {value}
ENTRY = Metric({key}, {label}, "m", value{more})
"""
SENSOR = """
from spinfilters.models.sensors.{module} import {name} as OWN
import copy
ENTRY = copy.copy(OWN)
"""
RAISED = {
    "a ValueError": "raise ValueError('shapes differ\\nin two lines')",
    "a KeyError": "return {}['x']",
    "a TypeError": "return None + 1",
    "an exit": "raise SystemExit(3)",
    "an assertion": "assert False",
    "recursion": "return (lambda f: f(f))(lambda f: f(f))",
    "a missing file": "return open('/no/such/file')",
    "a numerical error": "import numpy; return numpy.linalg.inv(numpy.zeros((2, 2)))",
    "nothing": "return None",
    "a text": "return 'x'",
    "an object": "return object()",
}
"""Bodies of functions that are called in a run."""
USED = ("compare", "{in}", "-o", "{out}/run", "--estimators", "mekf,mine")
DRAWN = ("plot", "{in}/run", "-o", "{out}/drawn", "--figures", "mine")


def installed(group: str, module: str | None, entry_point: str = "mine = stranger:ENTRY") -> Change:
    """Install a distribution with one entry point in the folder ``site``."""

    def change(place: Path) -> None:
        information = place / "site" / f"{MODULE}-1.0.dist-info"
        information.mkdir(parents=True)
        (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {MODULE}\nVersion: 1.0\n")
        (information / "entry_points.txt").write_text(f"[spinfilters.{group}]\n{entry_point}\n")
        if module is not None:
            (place / "site" / f"{MODULE}.py").write_text(module)

    return change


def plugin_cases() -> Iterator[Case]:
    """All of them, in a run of the gyro."""
    for number, (what, module) in enumerate(UNUSABLE.items()):
        group = list(KINDS)[number % len(KINDS)]  # one loader serves them all
        yield _case(f"{group}: {what}", installed(group, module))
    for group in KINDS:
        yield _case(f"{group}: a number in each group", installed(group, "ENTRY = 3\n"))
    points = (
        "mine = stranger",
        "mine = ",
        "mine = a b c",
        "mine = stranger:ENTRY.a.b",
        "mine = :x",
        "= stranger:ENTRY",
        "mine",
        "mine = ../../x:y",
    )
    for point in points:
        yield _case(f"entry point {point!r}", installed("metrics", "ENTRY = 3\n", point))
    twice = "mine = stranger:ENTRY\nyours = stranger:ENTRY"
    yield _case("an estimator under two names", installed("estimators", _estimator(), twice), USED)
    yield from _estimators()
    yield from _readers()
    yield from _figures()
    yield from _metrics()
    for module, name in (("gyro", "GYRO"), ("pose", "POSE")):
        yield _case(
            f"a sensor of a built-in name: {name}",
            installed("sensors", SENSOR.format(module=module, name=name)),
        )


def _case(name: str, change: Change, arguments: Sequence[str] = COMPARE, original: str = "gyro") -> Case:
    return Case(f"plug-in: {name}", original, change, arguments, pictures=original == "run", installs=True)


def _estimator(build: str = "return None", attributes: str = "pass") -> str:
    return ESTIMATOR.format(build=build, attributes=attributes)


def _estimators() -> Iterator[Case]:
    for what, body in RAISED.items():
        yield _case(f"build: {what}", installed("estimators", _estimator(body)), USED)
    for attributes in (
        "name = 'mekf'",
        "name = 3",
        "name = None",
        "name = 'a/../b'",
        "name = ''",
        "name = 'x\\n\\x1b[2J'",
        "order = 'x'",
        "order = None",
        "order = float('nan')",
        "del name",
    ):
        yield _case(
            f"estimator with {attributes}", installed("estimators", _estimator(attributes=attributes)), USED
        )
    for method in ("batch", "begin", "final", "noise", "points", "false_alarm_probability"):
        text = f"def {method}(self, *_):\n        raise ValueError('no')"
        build = "from spinfilters.run.estimators import OWN; return OWN[0].build(setup, settings)"
        yield _case(f"{method}: a ValueError", installed("estimators", _estimator(build, text)), USED)


def _readers() -> Iterator[Case]:
    for what, body in RAISED.items():
        module = READER.format(attributes="pass", recognises=body, read="return None")
        yield _case(f"recognises: {what}", installed("readers", module))
        module = READER.format(attributes="pass", recognises="return True", read=body)
        yield _case(f"read: {what}", installed("readers", module))
    for attributes in ("name = 'data set folder'", "name = 3", "order = 'x'", "words = None"):
        module = READER.format(attributes=attributes, recognises="return False", read="return None")
        yield _case(f"reader with {attributes}", installed("readers", module))


def _figures() -> Iterator[Case]:
    for what, body in RAISED.items():
        module = FIGURE.format(attributes="pass", draw=body)
        yield _case(f"draw: {what}", installed("figures", module), DRAWN, "run")
    for attributes in (
        "name = 'errors'",
        "name = 3",
        "name = '../../../../x'",
        "order = 'x'",
        "caption = None",
        "def names(self, estimators): return 3",
        "def names(self, estimators): raise ValueError",
    ):
        module = FIGURE.format(
            attributes=attributes, draw="from matplotlib.figure import Figure; return Figure()"
        )
        yield _case(f"figure with {attributes}", installed("figures", module), DRAWN, "run")


def _metrics() -> Iterator[Case]:
    def module(value: str = "return 1.0", key: str = "'mine'", label: str = "'mine'", more: str = "") -> str:
        return METRIC.format(value=value, key=key, label=label, more=more)

    for what, body in RAISED.items():
        yield _case(f"metric: {what}", installed("metrics", module(body)))
    for what, text in {
        "the key of another": module(key="'nis'"),
        "a key that is a number": module(key="3"),
        "an empty key": module(key="''"),
        "a key below a number": module(key="'runtime_s.total.x'"),
        "a label that is None": module(label="None"),
        "a scale that is a text": module(more=", scale='x'"),
        "a form that fails": module(more=", form=lambda *_: 1 / 0"),
        "a form that gives a number": module(more=", form=lambda *_: 3"),
        "a section of its own": module(more=", section='x'"),
        "NaN": module("return float('nan')"),
        "a number of 2^4000": module("return 2**4000"),
        "a list within lists of other lengths": module("return [[1], [1, 2]]"),
        "a set": module("return {1}"),
    }.items():
        yield _case(f"metric: {what}", installed("metrics", text))


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them all; exit code 1 where one did what it must not."""
    assert __doc__ is not None
    return campaign("tests.hostile.plugins", list(plugin_cases()), parser(__doc__).parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
