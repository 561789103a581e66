"""The table of figures: one file each; one from outside the package is drawn with every run."""

import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import spinfilters
from spinfilters.api.runs import Run
from spinfilters.errors import InputError
from spinfilters.workflow.figure_entry import TABLE, figure_entries, picture_files
from spinfilters.workflow.figures import Pictured, draw_run

DOCS = Path(__file__).parents[2] / "docs"
PROGRAM = re.findall(
    r"^```python\n(.*?)^```", (DOCS / "how-to" / "add-a-figure.md").read_text(), re.MULTILINE | re.DOTALL
)[0]


@pytest.fixture
def module(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The module of the how-to page in an installed distribution, on the path."""
    information = tmp_path / "site" / "spin_speed-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text("Metadata-Version: 2.1\nName: spin-speed\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text("[spinfilters.figures]\nspin-speed = spin_speed:FIGURE\n")
    file = information.parent / "spin_speed.py"
    file.write_text(PROGRAM)
    monkeypatch.syspath_prepend(str(information.parent))
    TABLE.reload()
    yield file
    monkeypatch.undo()
    sys.modules.pop("spin_speed", None)
    TABLE.reload()


def test_every_figure_of_the_table_is_in_the_documentation_with_its_caption() -> None:
    page = (DOCS / "how-to" / "run-folder.md").read_text()
    listed = re.findall(r"^\| `([a-z-]+)(?:-<estimator>)?\.png` \| (.*) \|$", page, re.MULTILINE)
    assert listed == [(entry.name, entry.caption) for entry in figure_entries()]


@pytest.fixture(scope="module")
def run() -> Run:
    return spinfilters.compare(
        spinfilters.simulate("gyro", seed=1, frames=40, interval=0.1), estimators="mekf"
    )


def _pictured(run: Run) -> Pictured:
    return Pictured(run.dataset, [each.evaluation for each in run.values()], None)


@pytest.mark.usefixtures("module")
def test_a_figure_from_outside_is_among_those_of_every_run(run: Run, tmp_path: Path) -> None:
    assert picture_files(("mekf",))[-1] == "spin-speed.png"
    silent: Callable[[int, int], None] = lambda *_: None  # noqa: E731
    assert draw_run(_pictured(run), tmp_path, silent, ["spin-speed.png"]) == ["spin-speed.png"]
    assert (tmp_path / "spin-speed.png").stat().st_size > 1000
    title = run.figure("spin-speed").axes[0].get_title()
    assert title == "Rate of rotation of every estimator over time."


def test_a_figure_that_needs_what_a_run_lacks_is_left_out_and_says_so(
    module: Path, run: Run, tmp_path: Path
) -> None:
    module.write_text(PROGRAM.replace("return None if", 'return "a thermometer" if'))
    with pytest.raises(InputError, match=r"needs a thermometer; choose from summary, rates"):
        run.figure("spin-speed")
    assert draw_run(_pictured(run), tmp_path, lambda *_: None, ["spin-speed.png"]) == []


def test_a_name_that_stands_twice_is_refused(module: Path) -> None:
    module.write_text(PROGRAM.replace('"spin-speed"', '"rates"'))
    with pytest.raises(InputError, match="'rates' is registered twice"):
        figure_entries()
