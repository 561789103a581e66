"""Every command that README, docs and help offer for pasting runs, on small sizes, and none ends in a trace."""

import importlib.util
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spinfilters.campaigns import filter_comparison
from spinfilters.campaigns.dask_cluster import DaskCluster
from spinfilters.campaigns.study import Study, study_from
from spinfilters.cli.main import main, parser
from spinfilters.io.dataset_folder import write_dataset
from spinfilters.lidar.mesh import TriangleMesh, box
from spinfilters.simulation.board_images import drawn_poses, write_board_images
from spinfilters.simulation.image_sequence import ImageScenario, Imaging, example_rig, render
from spinfilters.simulation.scenario import RICH_RPM, Scenario, simulate
from spinfilters.vision.calibration_images import Board
from tests.campaigns.test_engine import InProcess
from tests.docs.pasted_commands import (
    MODULE,
    PAGES,
    REWRITINGS,
    added_to,
    arguments_of,
    blocks_of,
    inline_of,
    rewriting_of,
)
from tests.run.throws import carried

WITH_COMMANDS = [page for page in PAGES if blocks_of(page)]
MISSED_DEADLINE = 1  # of ``live`` on a busy machine
STUDY = """
[study]
name = "small"
seeds = 1
bound = "none"

[factors]
estimator = ["mekf"]
motion = ["short"]
sensor = ["gyro"]

[motion.short]
rate_rpm = [4.0, 9.0, 3.0]
epochs = 40

[sensor.gyro]
kind = "gyro"
"""
DRAWN_STUDY = STUDY.replace('bound = "none"', 'bound = "none"\ninitialisation = "drawn"').replace(
    "gyro", "pose"
)
"""For what begins all runs from drawn beliefs."""
FEW_EPOCHS = 20
"""Of a recording of a ready study."""
SMALLEST_RUN = 1  # of a campaign of two runs: in place of run 1234


def _write_stl(mesh: TriangleMesh, path: Path) -> None:
    """A mesh as ASCII STL."""
    lines = ["solid body"]
    for corners in mesh.vertices[mesh.triangles]:
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in corners.tolist()]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid body", ""]))


def _write_obj(mesh: TriangleMesh, path: Path) -> None:
    """A mesh as OBJ, whose indices begin at 1."""
    lines = [f"v {x} {y} {z}" for x, y, z in mesh.vertices.tolist()]
    path.write_text(
        "\n".join([*lines, *(f"f {a + 1} {b + 1} {c + 1}" for a, b, c in mesh.triangles.tolist()), ""])
    )


def _recording(folder: Path) -> None:
    """Poses for all that asks for a recording, and lines of them for ``live``."""
    dataset = simulate(Scenario.simplified(kind="pose", rate_rpm=RICH_RPM, epochs=40))
    write_dataset(dataset, folder / "my-recording")
    (stream,) = dataset.log.streams
    rows = np.column_stack([stream.time, stream.values])[-10:]
    lines = ["pose," + ",".join(f"{value:.9g}" for value in row) for row in rows]
    (folder / "pipe").write_text("\n\n".join([*lines, ""]))


def _tosses(folder: Path) -> None:
    """Two throws of a body, whose columns do not say their unit, alone and in a folder of recordings."""
    log = carried(0.005, np.random.default_rng(1))
    table = np.column_stack([log.time, np.rad2deg(log.rates)])
    np.savetxt(folder / "toss.csv", table, delimiter=",", header="time,gyroX,gyroY,gyroZ", comments="")
    (folder / "tosses").mkdir()
    told = np.column_stack([log.time, log.rates])
    np.savetxt(folder / "tosses" / "1.csv", told, delimiter=",", header="time_s,wx,wy,wz", comments="")
    told[:, 1:] = 0.0  # nothing flies in the other
    np.savetxt(folder / "tosses" / "2.csv", told, delimiter=",", header="time_s,wx,wy,wz", comments="")


def _boards(folder: Path) -> None:
    """Images of a chessboard, and a place for the calibration: they are larger than those of the body."""
    board, rig, generator = Board(9, 6, 0.025), example_rig(), np.random.default_rng(4)
    poses = drawn_poses("good", 10, rig, board, generator)
    write_board_images(folder / "boards", poses, rig, board, generator)
    (folder / "calibrated").mkdir()


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the pages take as given: a recording, throws, meshes, a study, images and their calibration."""
    folder = tmp_path_factory.mktemp("inputs")
    _recording(folder)
    _tosses(folder)
    _boards(folder)
    body = box((1.0, 1.4, 0.7))
    _write_stl(replace(body, vertices=1000 * body.vertices), folder / "body.stl")
    _write_obj(body, folder / "body.obj")
    (folder / "study.toml").write_text(STUDY)
    (folder / "drawn.toml").write_text(DRAWN_STUDY)
    (folder / "runs").mkdir()
    (folder / "floating.toml").write_text("[process]\ngravity = false\n")
    images = ImageScenario(
        Scenario(radius_m=0.13, epochs=8, interval=0.25),
        shape="box",
        size=(320, 240),
        imaging=Imaging(oversampling=1, stars=10),
    )
    render(images, folder / "images")
    return folder


@pytest.fixture
def small_studies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs of campaigns are made here, and recordings of ready studies are short: how Dask makes runs has tests of its own."""
    whole = filter_comparison.ready_study

    def short(name: str) -> Study:
        """A ready study with few epochs of the first and the last level of what it varies, all estimators."""
        document = dict(whole(name).document)
        document["motion"] = {
            title: {**motion, "epochs": FEW_EPOCHS} for title, motion in document["motion"].items()
        }
        document["factors"] = dict(document["factors"])
        for factor, levels in document["factors"].items():
            if factor != "estimator":
                ends = document["factors"][factor] = [levels[0], levels[-1]]
                if factor in document:
                    document[factor] = {
                        title: table for title, table in document[factor].items() if title in ("base", *ends)
                    }
        return study_from(document, name)

    monkeypatch.setattr(filter_comparison, "ready_study", short)
    monkeypatch.setattr(DaskCluster, "rows", lambda _, study, chunks: InProcess().rows(study, chunks))


@pytest.fixture
def place(
    inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unrendered: None, small_studies: None
) -> Path:
    """A folder of a page's own with the inputs, as the one where commands are run; figures are composed and not rendered.

    Pages share nothing, so that none depends on those which ran before it.
    """
    folder = tmp_path / "page"
    shutil.copytree(inputs, folder)
    monkeypatch.chdir(folder)
    return folder


def _code(arguments: list[str]) -> int:
    """Exit code of ``spinfilters`` in this process."""
    try:
        return int(main(arguments) or 0)
    except SystemExit as stop:
        return int(stop.code or 0)


@contextmanager
def _standard_input(path: str | None) -> Iterator[None]:
    """Standard input from a file, as a shell's ``<`` gives it."""
    if path is None:
        yield
        return
    with Path(path).open() as given, pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "stdin", given)
        yield


@pytest.mark.parametrize("page", WITH_COMMANDS, ids=lambda page: page.stem)
def test_every_command_of_a_page_runs(page: Path, place: Path, capfd: pytest.CaptureFixture[str]) -> None:
    every = [small for command in blocks_of(page) if (small := _small(command)) is not None]
    for small in dict.fromkeys(every):
        code = _run(small, place)
        said = capfd.readouterr()
        fine = (0, MISSED_DEADLINE) if small.startswith("spinfilters live") else (0,)
        assert code in fine, (small, said.err)
        assert "Traceback" not in said.err + said.out, small
        assert "unexpected" not in said.err, small


def _small(command: str) -> str | None:
    """A command at reduced size; None of one that a test does not run."""
    change = rewriting_of(command)
    if change is not None and change.added is None:
        return None
    redirected = re.search(r"\s+[<>]\s*\S+", command)
    tail = "" if redirected is None else redirected[0]
    body = command.replace(tail, "") if tail else command
    if "toss.csv" in body and "--unit" not in body:
        tail = f" --unit deg/s{tail}"  # the pages' own recording says its unit
    for old, new in (
        (" 1234 -o", f" {SMALLEST_RUN - 1} -o"),
        ("--segment 6.55:7.4", "--segment 2.0:3.0"),
        ("-o images", "-o rendered") if "simulate" in body else ("", ""),
        ("runs/images", "runs/mine"),
        ("rig/cam1 images/", "rig/cam1 calibrated/"),
        ("--difference older-rig", "--difference rig"),
        ("runs/first", "runs/mine"),
        ("body.stl --scans", "body.stl --scale 0.001 --scans"),
        ("study.toml -o runs/study --batch", "drawn.toml -o runs/batch --batch"),
        ("study motions rates noise initial-error", "study noise initial-error"),
        (
            "reproduce tweddle-table-1.1 tweddle-figure-2 -o",
            "reproduce tweddle-table-1.1 tweddle-figure-2-6 -o",
        ),
    ):
        body = body.replace(old, new) if old else body
    return f"{body} {added_to(body, change)}".strip() + tail


def _run(command: str, place: Path) -> int:
    """Exit code of a command."""
    words = shlex.split(command)
    if words[0] != "spinfilters":
        return subprocess.run(command, shell=True, cwd=place, check=False, capture_output=True).returncode
    source = words[words.index("<") + 1] if "<" in words else None
    kept = words[1:]
    for sign in "<>":
        if sign in kept:
            at = kept.index(sign)
            kept = kept[:at] + kept[at + 2 :]
    kept = [
        name for word in kept for name in (sorted(map(str, Path().glob(word))) if "*" in word else [word])
    ]
    with _standard_input(source):
        return _code(kept)


@pytest.mark.parametrize("page", [page for page in PAGES if inline_of(page)], ids=lambda page: page.stem)
def test_the_options_of_a_command_in_prose_exist(page: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for command in inline_of(page):
        with suppress(SystemExit):  # of a command that is quoted in part
            parser().parse_args(arguments_of(command))
        said = capsys.readouterr().err
        assert not said or "required" in said or "expected" in said, (command, said)


def test_a_command_that_help_quotes_exists(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parser().parse_args(["--help"])
    names = re.findall(r"^ +([a-z]+)  ", capsys.readouterr().out, re.MULTILINE)
    assert len(names) > 10
    quoted: set[str] = set()
    for name in names:
        with pytest.raises(SystemExit):
            parser().parse_args([name, "--help"])
        text = " ".join(capsys.readouterr().out.split())
        quoted |= {each.split()[0] for each in re.findall(r"'spinfilters ([^']*)'", text)}
    assert quoted <= set(names)


def test_a_module_that_a_page_runs_exists() -> None:
    named = {module for page in PAGES for module in MODULE.findall(page.read_text())}
    assert len(named) > 10
    assert not {module for module in named if importlib.util.find_spec(module) is None}


def test_a_command_that_names_its_estimators_runs_with_them() -> None:
    naming = [command for page in PAGES for command in blocks_of(page) if "--estimators" in command]
    assert any("posterior" in command for command in naming)
    small = [small for command in naming if (small := _small(command)) is not None]
    assert all(command.count("--estimators") == 1 for command in small), small


def test_every_rewriting_serves_a_command_and_gives_its_reason() -> None:
    commands = [command for page in PAGES for command in blocks_of(page)]
    for each in REWRITINGS:
        assert any(rewriting_of(command) is each for command in commands), each.words
        assert each.reason
