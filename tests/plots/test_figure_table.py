"""The table of figures: one file each; one from outside the package is drawn with every run."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from contracts.plugin import installed_plugin, program_of

import spinfilters
from spinfilters.api.comparison import Run
from spinfilters.core.errors import InputError
from spinfilters.plots.figures import FigureData, draw_run, figure_entries, picture_files

DOCS = Path(__file__).parents[2] / "docs"
PROGRAM = program_of(DOCS / "how-to" / "add-a-figure.md")


@pytest.fixture
def module(tmp_path: Path) -> Iterator[Path]:
    """The module of the how-to page in an installed distribution, on the path."""
    with installed_plugin("spinfilters.figures", "spin-speed = spin_speed:FIGURE", PROGRAM, tmp_path) as file:
        yield file


def test_every_figure_of_the_table_is_in_the_documentation_with_its_caption() -> None:
    page = (DOCS / "how-to" / "run-folder.md").read_text()
    listed = re.findall(r"^\| `([a-z-]+)(?:-<estimator>)?\.png` \| (.*) \|$", page, re.MULTILINE)
    assert listed == [(entry.name, entry.caption) for entry in figure_entries()]


@pytest.fixture(scope="module")
def run() -> Run:
    return spinfilters.compare(
        spinfilters.simulate("gyro", seed=1, frames=40, interval=0.1), estimators="mekf"
    )


def _pictured(run: Run) -> FigureData:
    return FigureData(run.dataset, [each.evaluation for each in run.values()], None)


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
