"""``spinfilters observe``: what it prints, writes and refuses."""

import json
from pathlib import Path

import pytest

from observability.cases import CHARTS, UNKNOWNS
from observability.system import analysed_sensors
from spinfilters.cli.main import main

QUICK = ["--frames", "6", "--interval", "0.5"]


def observed(folder: Path, *arguments: str) -> dict:
    """The document of a run."""
    assert main(["observe", "-o", str(folder), *QUICK, *arguments]) == 0
    return json.loads((folder / "observe.json").read_text())


def test_the_default_is_the_thesis_with_four_landmarks_and_lacks_its_gauge(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    found = observed(tmp_path / "run")
    assert (found["rank"], found["dimension"], found["certified"]) == (26, 32, True)
    assert {each["group"] for each in found["not_determined"]} == {"gauge translation", "gauge rotation"}
    text = (tmp_path / "run" / "observe.txt").read_text()
    assert "26 of 32 unknowns are determined" in text
    assert text in capsys.readouterr().out.replace("\r", "")
    assert (tmp_path / "run" / "observe.png").read_bytes().startswith(b"\x89PNG")
    assert found["bound"]["inertia ratios [1]"] > 0


@pytest.mark.parametrize(
    ("arguments", "rank", "dimension"),
    [
        (["--sensor", "gyro"], 5, 5),
        (["--sensor", "gyro", "--chart", "tensor"], 8, 9),
        (["--sensor", "gyro", "--torque", "x"], 6, 6),
        (["--sensor", "gyro", "--torque", "z", "--rate-rpm", "0", "0", "10"], 4, 6),
        (["--sensor", "attitude"], 11, 11),
        (["--sensor", "pose"], 20, 20),
        (["--sensor", "pose", "--chart", "filter"], 20, 20),
        (["--sensor", "monocular"], 25, 32),
        (["--sensor", "monocular", "--manoeuvre", "x"], 26, 32),
        (["--sensor", "monocular", "--known-map"], 20, 20),
        (["--sensor", "lidar"], 26, 32),
        (["--sensor", "gyro", "--unknowns", "moments"], 5, 6),
        (["--sensor", "stereo", "gyro"], 29, 32),
        (["--sensor", "stereo,gyro"], 29, 32),
        (["--sensor", "attitude", "gyro"], 11, 11),
        (["--torque", "x"], 29, 33),
        (["--torque", "x", "--chart", "tensor"], 29, 33),
        (["--landmarks", "3", "--rate-rpm", "0", "0", "10"], 19, 29),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else str(value),
)
@pytest.mark.usefixtures("unrendered")
def test_every_sensor_and_input_has_its_rank(
    tmp_path: Path, arguments: list[str], rank: int, dimension: int
) -> None:
    found = observed(tmp_path, *arguments)
    assert (found["rank"], found["dimension"], found["certified"], found["unnamed"]) == (
        rank,
        dimension,
        True,
        0,
    )


@pytest.mark.usefixtures("unrendered")
def test_the_document_keeps_its_keys_and_says_what_rests_on_the_prior(tmp_path: Path) -> None:
    found = observed(tmp_path, "--rate-rpm", "0", "10", "0", "--torque", "y")
    old = {
        "case",
        "unknowns",
        "rank",
        "dimension",
        "ranks_by_order",
        "regular",
        "certified",
        "proof",
        "bound",
        "text",
    }
    assert old | {"not_determined", "unnamed"} <= found.keys()
    assert found["bound"].keys() == found["bound_verdicts"].keys()
    assert "principal axes" in found["axes"]
    assert found["not_asked"] == []
    assert any("torque about y: 0.1 N m" in words for words in found["assumed"])
    assert found["bound_verdicts"]["each moment, relative [1]"]["directions_not_determined"] == 2


@pytest.mark.usefixtures("unrendered")
def test_a_gyro_in_the_filters_state_is_asked_for_the_attitude_that_it_does_not_determine(
    tmp_path: Path,
) -> None:
    found = observed(tmp_path, "--sensor", "gyro", "--chart", "filter")
    assert {each["group"] for each in found["not_determined"]} == {"attitude in inertial space"}
    assert "Not determined, 3: attitude in inertial space (3)." in found["text"]
    assert "attitude" in found["asked"]
    assert "attitude" not in found["not_asked"]


@pytest.mark.parametrize("sensors", [["magnetometer"], ["gyro", "magnetometer"]], ids=" ".join)
@pytest.mark.usefixtures("unrendered")
def test_the_heading_about_a_field_is_one_direction_by_the_same_name_in_rank_and_bound(
    tmp_path: Path, sensors: list[str]
) -> None:
    found = observed(tmp_path, "--sensor", *sensors, "--rate-rpm", "0", "10", "0")
    (sentence,) = [each for each in found["text"] if each.startswith("Not determined")]
    assert "attitude in inertial space: rotation of i about z" in sentence
    attitude = found["bound_verdicts"]["attitude [rad]"]
    assert len(attitude["prior_only_directions"]) == attitude["directions_not_determined"] == 1
    assert "z of frame i): not determined" in attitude["text"]
    assert "definition" not in attitude["text"]


@pytest.mark.usefixtures("unrendered")
def test_directions_name_their_frame_and_moving_ones_their_epoch(tmp_path: Path) -> None:
    observed(tmp_path, "--sensor", "monocular")
    lines = (tmp_path / "observe.txt").read_text().splitlines()
    directed = {line[2:30].strip(): line for line in lines if line.startswith("  ") and " along (" in line}
    assert {"velocity", "centre of mass in g", "place of the centre of mass"} <= directed.keys()
    for name in ("velocity", "place of the centre of mass"):
        assert ") (frame i, at the last epoch): " in directed[name]
    assert ") (frame g): " in directed["centre of mass in g"]
    (axes,) = [line for line in lines if line.startswith("Axes: ")]
    assert "frame g along these axes" in axes
    assert "frame i along the camera's axes at the first frame" in axes


@pytest.mark.usefixtures("unrendered")
def test_further_sensors_are_in_text_document_and_figure(tmp_path: Path) -> None:
    found = observed(tmp_path, "--sensor", "gyro", "--further")["further_sensors"]
    assert found["beside"] == ["gyro"]
    (attitude,) = [each for each in found["sensors"] if each["sensor"] == "attitude"]
    assert (attitude["rank"], attitude["dimension"]) == ([5, 11], [5, 11])
    assert attitude["becomes_determined"] == {"attitude [rad]": 3}
    assert attitude["bounds"]["attitude [rad]"]["before"] is None
    rate = attitude["bounds"]["body rate [rad/s]"]
    assert rate["before"] / rate["after"] == pytest.approx(rate["gain"])
    assert "Further sensors beside gyro" in (tmp_path / "observe.txt").read_text()
    assert (tmp_path / "further.png").exists()


@pytest.mark.usefixtures("unrendered")
def test_an_input_is_compared_with_the_same_question_without_it(tmp_path: Path) -> None:
    found = observed(tmp_path / "a", "--sensor", "monocular", "--frames", "60", "--manoeuvre", "x")
    alone = observed(tmp_path / "b", "--sensor", "monocular", "--frames", "60")
    assert alone["gain_of_inputs"] is None
    gain = found["gain_of_inputs"]
    assert gain["rank"] == [25, 26]
    assert gain["dimension"] == [32, 32]
    falls = {name for name, value in alone["bound"].items() if found["bound"][name] < 0.9 * value}
    assert gain["bounds_that_fall"].keys() == falls != set()
    for name, pair in gain["bounds_that_fall"].items():
        assert pair == [alone["bound"][name], found["bound"][name]]
    (line,) = [
        each for each in (tmp_path / "a" / "observe.txt").read_text().splitlines() if each.startswith("Gain")
    ]
    assert line.startswith("Gain of the known inputs: rank 25 of 32 -> 26 of 32; ")
    assert " -> " in line.split("; ", 1)[1]
    assert "Gain" not in (tmp_path / "b" / "observe.txt").read_text()


@pytest.mark.usefixtures("unrendered")
def test_an_input_that_tells_nothing_is_said_to_tell_nothing(tmp_path: Path) -> None:
    found = observed(tmp_path, "--sensor", "pose", "--manoeuvre", "x", "--manoeuvre-size", "1e-6")
    assert found["gain_of_inputs"]["bounds_that_fall"] == {}
    assert (
        "rank 20 of 20 -> 20 of 20; no bound falls by more than 10 %."
        in (tmp_path / "observe.txt").read_text()
    )


def test_help_names_every_sensor_and_the_axes(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "1000")
    with pytest.raises(SystemExit):
        main(["observe", "--help"])
    said = capsys.readouterr().out
    for word in (
        *analysed_sensors(),
        *CHARTS,
        *UNKNOWNS,
        "principal axes",
        "camera's axes",
        "--input-period",
    ):
        assert word in said
    options = said.split("\n  --")[1:]
    assert len(options) >= 14
    for each in options:
        assert len(each.split()) > 4, f"no word of help: {each}"


@pytest.mark.usefixtures("unrendered")
def test_a_second_run_replaces_the_first(tmp_path: Path) -> None:
    assert observed(tmp_path)["rank"] == 26
    assert observed(tmp_path, "--landmarks", "1")["rank"] == 17


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--sensor", "sonar"], "sensor 'sonar' is unknown; use one of attitude"),
        (["--chart", "mercator"], "chart 'mercator' is unknown"),
        (["--landmarks", "0"], "--landmarks: '0' is not allowed; give a whole number from 1 to 200"),
        (["--landmarks", "100000"], "give a whole number from 1 to 200"),
        (["--frames", "0"], "--frames: '0' is not allowed; give a whole number from 1"),
        (["--interval", "-1"], "--interval: '-1' is not allowed; give a number from 1e-06 to 100000 s"),
        (["--interval", "1e-300"], "give a number from 1e-06 to 100000 s"),
        (["--interval", "1e300"], "give a number from 1e-06 to 100000 s"),
        (["--rate-rpm", "1e300", "0", "0"], "give a number from -1e+06 to 1e+06 rpm"),
        (["--interval", "1e5"], "at most 100 revolutions between epochs"),
        (["--moments", "1", "1", "5"], "are no motion"),
        (["--rate-rpm", "nan", "0", "0"], "'nan' is not allowed"),
        (["--torque", "x", "--chart", "filter"], "which the filters' state does not hold"),
        (["--sensor", "stereo", "stereo"], "sensors stereo, stereo; give each once"),
        (["--sensor", ","], "or a list of at least one"),
        (["--unknowns", "mass"], "unknowns 'mass' is unknown; use one of ratios, moments"),
        (
            ["--unknowns", "moments", "--chart", "tensor"],
            "the three moments are unknowns of the chart principal",
        ),
        (
            ["--torque", "x", "--torque-size", "0"],
            "--torque-size: '0' is not allowed; give a number from 1e-06 to 1e+06 N m",
        ),
        (
            ["--manoeuvre", "x", "--input-period", "0"],
            "--input-period: '0' is not allowed; give a number from 1e-06 to 1e+06 s",
        ),
        (["--manoeuvre", "z", "--manoeuvre-size", "1"], "carries the camera past the body"),
        (["--sensor", "gyro", "--manoeuvre", "x"], "an inspector's manoeuvre needs a velocity"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_bad_input_is_refused_in_one_line(
    tmp_path: Path, arguments: list[str], text: str, capsys: pytest.CaptureFixture
) -> None:
    try:
        code = main(["observe", "-o", str(tmp_path / "run"), *arguments])
    except SystemExit as stopped:
        code = stopped.code
    complaint = capsys.readouterr().err
    assert code == 2
    assert text in complaint
    assert complaint.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_a_folder_of_something_else_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "thesis.tex").write_text("chapter 1")
    assert main(["observe", "-o", str(tmp_path), *QUICK]) == 2
    assert "is not empty and no result of observe" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_a_study_writes_maps_of_the_bound(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, values in (
        ("DURATIONS", (1.0, 3.0)),
        ("INTERVALS", (0.5, 1.0)),
        ("COUNTS", (2, 6)),
        ("ANGLES", (0.0, 40.0)),
    ):
        monkeypatch.setattr(f"observability.bound_study.{name}", values)
    observed(tmp_path, "--study", "--frames", "9")
    found = json.loads((tmp_path / "study.json").read_text())
    for curve in found["curves"]:
        first, last = curve["std"]["inertia ratios [1]"]
        assert (last < first) == (curve["against"] != "seconds between frames"), curve["against"]
    spin, tumble = (
        found["inertia_ratios_by_motion"]["std"][0][0],
        found["inertia_ratios_by_motion"]["std"][1][1],
    )
    assert spin > 2 * tumble
    for name in ("study.png", "conditioning.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("place", ["a file", "a file/below", "/proc/nothing"])
def test_a_folder_that_cannot_be_made_is_named(
    tmp_path: Path, place: str, capsys: pytest.CaptureFixture
) -> None:
    (tmp_path / "a file").write_text("kept")
    assert main(["observe", "-o", str(tmp_path / place), *QUICK]) == 2
    complaint = capsys.readouterr().err
    assert "cannot be made a folder" in complaint
    assert complaint.count("\n") == 1
    assert (tmp_path / "a file").read_text() == "kept"
