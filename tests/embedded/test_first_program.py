"""The program that the embedded filter comes with: it compiles, runs, and reads rows from standard input."""

import csv
import shutil
import subprocess
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from spinfilters.cli.main import main
from spinfilters.core.mass_distribution import inertia_matrix
from spinfilters.embedded.embedded_estimator import real_type
from spinfilters.embedded.embedded_options import EmbedOptions, Real
from spinfilters.embedded.folder import folder_texts
from spinfilters.embedded.library import load_filter

needs_compiler = pytest.mark.skipif(
    shutil.which("make") is None or shutil.which("cc") is None, reason="no make or no C compiler"
)


def built(folder: Path, *options: str) -> str:
    """The path of the compiled program of a folder that ``embed`` writes."""
    assert main(["embed", "-o", str(folder), *options]) == 0
    done = subprocess.run(["make", "-s", "spinfilter_main"], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "warning" not in done.stderr
    return str(folder / "spinfilter_main")


def rows_of(program: str, text: str | None = None, *time: str) -> list[dict[str, float]]:
    """What a program prints, as numbers by column; with a text that is its standard input, from a start state of that time."""
    command = [program] if text is None else [program, "-", *time]
    done = subprocess.run(command, input=text or "", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return [
        {name: float(value) for name, value in row.items()}
        for row in csv.DictReader(done.stdout.splitlines())
    ]


@pytest.mark.parametrize(("sensor", "remark"), [("gyro", True), ("pose", False)])
def test_the_start_state_says_which_disturbance_a_filter_without_a_position_leaves_out(
    sensor: Literal["gyro", "pose"], remark: bool
) -> None:
    text = folder_texts(EmbedOptions(sensor=sensor))["start_state.h"]
    assert ("a state without a position does not use it" in text) is remark


@pytest.fixture(scope="module")
def gyro_program(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The program of a gyro, compiled once for all tests that only run it."""
    return built(tmp_path_factory.mktemp("gyro") / "filter", "--sensor", "gyro")


@needs_compiler
@pytest.mark.parametrize("sensor", ["gyro", "pose", "stereo"])
def test_the_program_filters_its_built_in_recording(
    tmp_path: Path, sensor: str, request: pytest.FixtureRequest
) -> None:
    is_gyro = sensor == "gyro"
    rows = rows_of(
        request.getfixturevalue("gyro_program") if is_gyro else built(tmp_path / "filter", "--sensor", sensor)
    )
    assert len(rows) == 60
    assert sum(row["status"] != 0 for row in rows) <= 3
    assert all(row["moment_1"] <= row["moment_2"] <= row["moment_3"] == 1 for row in rows)


@needs_compiler
def test_rates_from_standard_input_give_a_filter_that_follows_them(gyro_program: str) -> None:
    lines = [f"{0.1 * k:.3f}, 0.1, 1.05, 0.05" for k in range(5)]
    rows = rows_of(gyro_program, "time_s,wx,wy,wz\n" + "\n".join(lines) + "\n")
    assert [row["time_s"] for row in rows] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    assert rows[-1]["wy"] == pytest.approx(1.05, abs=0.02)


@needs_compiler
def test_from_a_stated_time_earlier_rows_are_skipped_and_the_first_later_one_is_predicted(
    gyro_program: str,
) -> None:
    lines = [f"{0.1 * k:.3f}, 0.1, 1.05, 0.05" for k in range(5)]
    text = "time_s,wx,wy,wz\n" + "\n".join(lines) + "\n"
    later = rows_of(gyro_program, text, "0.2")
    assert [row["time_s"] for row in later] == pytest.approx([0.3, 0.4])
    undelayed = rows_of(gyro_program, "\n".join(lines[3:]) + "\n")
    turned = [
        2 * np.arccos(abs(sum(a[q] * b[q] for q in ("qx", "qy", "qz", "qw"))))
        for a, b in zip(later[:1], undelayed[:1], strict=True)
    ]
    assert turned[0] == pytest.approx(0.1 * np.linalg.norm([0.1, 1.05, 0.05]), rel=0.05)


@needs_compiler
@pytest.mark.parametrize("arguments", [["-", "x"], ["-", "inf"], ["-", "1s"], ["-", "1", "2"], ["1"]])
def test_an_argument_of_no_use_is_answered_with_the_usage(gyro_program: str, arguments: list[str]) -> None:
    done = subprocess.run([gyro_program, *arguments], input="", capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("usage: ")


@needs_compiler
def test_rows_that_all_precede_the_stated_time_are_refused(gyro_program: str) -> None:
    done = subprocess.run([gyro_program, "-", "9"], input="1,0.1,1,0.05\n", capture_output=True, text=True)
    assert done.returncode == 2
    assert "later than the start state" in done.stderr


@needs_compiler
@pytest.mark.parametrize("second", ["0.0,0.1,1,0.05", "0.1,0.1,1", "0.1,0.1,1,x", "-1,0.1,1,0"])
def test_a_row_of_no_use_is_named_by_its_line(gyro_program: str, second: str) -> None:
    done = subprocess.run(
        [gyro_program, "-"], input=f"t,x,y,z\n0,0.1,1,0.05\n{second}\n", capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith("line 3: ")


@pytest.mark.parametrize("time", ["inf", "nan", "1e400"])
def test_a_first_time_that_is_not_finite_is_named(gyro_program: str, time: str) -> None:
    done = subprocess.run(
        [gyro_program, "-"], input=f"{time},0.1,1,0.05\n1,0.1,1,0\n", capture_output=True, text=True
    )
    assert done.returncode == 2
    assert done.stderr.startswith("line 1: its time is not finite")


@pytest.mark.parametrize(("real", "tolerance"), [("double", 1e-12), ("float", 2e-6)])
@pytest.mark.parametrize(
    "s",
    [
        (0, 0, 0, 0, 0),
        (0.3, -0.1, 0.2, -0.4, 0.1),
        (1, 1, 0, 0, 0),
        (-2, 1.5, 0.7, 1, -2),
        (0, 0, 1e-9, 0, 0),
    ],
)
def test_principal_moments_in_c_are_those_of_python(
    real: Real, tolerance: float, s: tuple[float, ...]
) -> None:
    options = EmbedOptions("gyro", real=real)
    library = load_filter(options)
    if library is None:
        pytest.skip("no C compiler")
    number = real_type(options)
    found = (number * 3)()
    library.sf_principal_moments((number * 5)(*s), found)
    moments = np.linalg.eigvalsh(inertia_matrix(np.array(s)))
    np.testing.assert_allclose(list(found), moments / moments[-1], rtol=tolerance)


def test_every_file_states_its_licence() -> None:
    for name, text in folder_texts(EmbedOptions("gyro")).items():
        head = text if name == "library.json" else text.splitlines()[0]
        assert ("MIT" if name == "library.json" else "SPDX-License-Identifier: MIT") in head, name


@needs_compiler
def test_a_filter_begins_from_the_last_state_of_a_run(tmp_path: Path) -> None:
    data, run = str(tmp_path / "data"), tmp_path / "run"
    assert (
        main(["simulate", "-o", data, "--kind", "gyro", "--rate-rpm", "4", "9", "3", "--frames", "70"]) == 0
    )
    noise = ["--set", "sensors.gyro_noise_std=0.0123", "--set", "process.torque_psd=3e-7"]
    assert main(["compare", data, "-o", str(run), "--estimators", "mekf", "--no-figures", *noise]) == 0
    first = rows_of(built(tmp_path / "filter", "--sensor", "gyro", "--from-run", str(run)))[0]
    assert " s of its clock." in (tmp_path / "filter" / "start_state.h").read_text()
    last = list(csv.DictReader((run / "mekf" / "trajectory.csv").read_text().splitlines()))[-1]
    speed = np.linalg.norm([float(last[name]) for name in ("wx", "wy", "wz")])
    assert np.linalg.norm([first[name] for name in ("wx", "wy", "wz")]) == pytest.approx(speed, rel=0.1)
    assert main(["embed", "-o", str(tmp_path / "other"), "--sensor", "pose", "--from-run", str(run)]) == 2
    assert (
        main(["embed", "-o", str(tmp_path / "same"), "--sensor", "gyro", "--from-run", str(run / "mekf")])
        == 0
    )
    biased = ["--sensor", "gyro", "--gyro-bias-std", "0.01", "--from-run", str(run)]
    assert main(["embed", "-o", str(tmp_path / "biased"), *biased]) == 2
    begun = [(tmp_path / name / "start_state.h").read_text() for name in ("filter", "same")]
    assert begun[0] == begun[1]
    assert "the last state of mekf in run" in begun[0]
    assert (
        "(sf_real)2.9999999999999999e-07}" in begun[0]
    )  # density of the torque, and the noise of the gyro: those of the run
    assert "(sf_real)0.0123, (sf_real)0}" in begun[0]


@pytest.mark.skipif(shutil.which("cmake") is None, reason="cmake is not installed")
@needs_compiler
def test_cmake_builds_the_library_and_passes_its_tests(tmp_path: Path) -> None:
    folder = tmp_path / "filter"
    assert main(["embed", "-o", str(folder), "--sensor", "gyro"]) == 0
    for command in (
        ["cmake", "-B", "build"],
        ["cmake", "--build", "build"],
        ["ctest", "--test-dir", "build"],
    ):
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
        assert done.returncode == 0, done.stdout + done.stderr
