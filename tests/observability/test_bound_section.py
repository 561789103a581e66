"""A table bound in a model's file asks how well: along formulas and recordings, over several experiments."""

import json
from pathlib import Path

import numpy as np
import pytest

from observability.bound_section import StatedBound, stated_bound
from observability.model_analysis import read_model
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError

PUSHED = """
states = ["x", "v"]
parameters = ["k", "m"]
inputs = ["F"]
[equations]
x = "v"
v = "(F - k*x)/m"
[outputs]
y = "x"
[bound]
duration = 6
interval = 0.1
values = {x = 1, v = 0, k = 4, m = 1}
noise = {y = 0.01}
"""


def stated(folder: Path, text: str) -> StatedBound:
    path = folder / "model.toml"
    path.write_text(text)
    found = stated_bound(read_model(path), path.name, folder)
    assert found is not None
    return found


def test_the_command_prints_and_writes_the_bound(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path, folder = tmp_path / "model.toml", tmp_path / "found"
    path.write_text(PUSHED + '[courses]\nF = "sin(t)"\n[bound.manoeuvres.hard]\nF = "9*sin(t)"\n')
    assert main(["observe", str(path), "-o", str(folder)]) == 0
    shown = capsys.readouterr().out
    assert "Cramer-Rao bound at t = 6 s" in shown
    assert "hard" in shown
    document = json.loads((folder / "observability.json").read_text())["bound"]
    assert document["gains"]["hard"]["m"] > 2
    assert document["gains"]["y"]["m"] is None
    assert len(document["experiments"][""]["std"]["m"]) == 61
    assert "<td>m</td><td>-</td>" in (folder / "observability.html").read_text()
    assert (folder / "observability.png").read_bytes().startswith(b"\x89PNG")


def test_a_bound_of_many_times_tells_its_progress(tmp_path: Path) -> None:
    path, told = tmp_path / "model.toml", []
    path.write_text(PUSHED.replace("interval = 0.1", "interval = 0.005") + '[courses]\nF = "sin(t)"\n')

    def show(name: str, done: int, total: int) -> None:
        told.append((name, done, total))

    found = stated_bound(read_model(path), path.name, tmp_path, show)
    assert found is not None
    assert found.last.final
    assert {name for name, _, _ in told} == {"trajectory", "bound"}
    assert max(told) == ("trajectory", 1201, 1201)
    assert [done for name, done, _ in told if name == "bound"] == [500, 1000]


def test_a_manoeuvre_says_what_it_loses(tmp_path: Path) -> None:
    found = stated(tmp_path, PUSHED + '[courses]\nF = "sin(t)"\n[bound.manoeuvres.off]\nF = 0\n')
    (line,) = [each for each in found.gain_sentences if each.startswith("  off")]
    assert "k (lost)" in line
    assert "m (lost)" in line


def test_a_recorded_input_is_as_good_as_its_formula(tmp_path: Path) -> None:
    time = np.linspace(0, 6, 601)
    rows = [f"{t},{np.sin(t)}" for t in time.tolist()]
    (tmp_path / "flight.csv").write_text("\n".join(["time_s,F", *rows]))
    formula = stated(tmp_path, PUSHED + '[courses]\nF = "sin(t)"\n').last.final
    taken = stated(tmp_path, PUSHED + '[courses]\nF = "from flight.csv"\n').last.final
    assert taken == pytest.approx(formula, rel=1e-2)


def test_a_recording_gives_times_inputs_and_states(tmp_path: Path) -> None:
    time = np.linspace(0, 6, 61)
    rows = [f"{t},{np.sin(t)},{np.cos(t)},{-np.sin(t)}" for t in time.tolist()]
    (tmp_path / "flight.csv").write_text("\n".join(["time_s,F,x,v", *rows]))
    own = PUSHED.replace(
        "duration = 6\ninterval = 0.1\n", 'recording = "flight.csv"\ntrajectory = ["x", "v"]\n'
    )
    found = stated(tmp_path, own.replace("{x = 1, v = 0, k", "{k")).last
    np.testing.assert_allclose(found.experiment.course.values[:, 0], np.cos(time))
    assert found.cross_check is None
    assert np.isfinite(found.final["m"])


def test_experiments_share_their_parameters(tmp_path: Path) -> None:
    text = PUSHED + "[experiments.free.courses]\nF = 0\n[experiments.pushed.courses]\nF = 2\n"
    found = stated(tmp_path, text)
    free, both = found.bounds["free"].final, found.bounds["pushed"].final
    assert np.isinf(free["m"])
    assert np.isfinite(both["m"])
    alone = stated(tmp_path, PUSHED + "[courses]\nF = 2\n").last.final
    assert both["k"] < 0.95 * alone["k"]
    assert set(found.last.document()["std"]) == {"x", "v", "k", "m"}


def test_known_initial_values_are_information(tmp_path: Path) -> None:
    known = stated(tmp_path, PUSHED + "[courses]\nF = 2\n[known_initial_values]\nx = 1\nv = 0\n").last
    assert known.std[0, 0] == 0.0
    assert known.final["k"] < 0.9 * stated(tmp_path, PUSHED + "[courses]\nF = 2\n").last.final["k"]


def test_a_frame_rate_below_the_motion_is_named(tmp_path: Path) -> None:
    slow = PUSHED.replace("k = 4", "k = 4000").replace('"(F - k*x)/m"', '"(F - k*x)/m - 0*v"')
    found = stated(tmp_path, slow + "[courses]\nF = 0\n").last
    assert found.aliased == {"y": pytest.approx(10.0)}
    assert "Aliasing: y moves faster than half its rate of 10 Hz" in str(found)
    assert stated(tmp_path, PUSHED + "[courses]\nF = 0\n").last.aliased == {}


def test_a_program_is_run_only_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "model.py"
    path.write_text('model = {"states": ["x"], "equations": {"x": 0}, "outputs": {"y": "x"}}\n')
    assert main(["observe", str(path), "-o", str(tmp_path / "found")]) == 2
    assert "--execute" in capsys.readouterr().err
    assert main(["observe", str(path), "--execute", "-o", str(tmp_path / "found")]) == 0
    path.write_text("model = 1/0\n")
    assert main(["observe", str(path), "--execute", "-o", str(tmp_path / "found")]) == 2
    assert "stops with ZeroDivisionError" in capsys.readouterr().err
    for text, shown in (("0", "exit(0)"), ("", "exit()"), ("'bye'", "exit('bye')")):
        path.write_text(f"import sys\nmodel = {{}}\nsys.exit({text})\n")
        assert main(["observe", str(path), "--execute", "-o", str(tmp_path / "found")]) == 2
        assert f"ends itself with {shown} before" in capsys.readouterr().err


def test_a_duration_of_all_beside_a_recording_of_one_has_its_cure(tmp_path: Path) -> None:
    (tmp_path / "flight.csv").write_text("time_s,F\n0,1\n1,2\n2,0\n")
    free, flown = (
        "[experiments.free.courses]\nF = 0\n",
        '[experiments.flown.bound]\nrecording = "flight.csv"\n',
    )
    with pytest.raises(
        InputError, match=r"flown: bound has duration .*give it to each experiment that has no"
    ):
        stated(tmp_path, PUSHED + free + flown)
    times = "duration = 6\ninterval = 0.1\n"
    own = PUSHED.replace(times, "") + free + "[experiments.free.bound]\n" + times + flown
    assert [*stated(tmp_path, own).flights] == ["free", "flown"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("duration = 6\n", "", "bound has no duration"),
        ("interval = 0.1", "interval = 0", "interval is 0; give a positive number"),
        ("interval = 0.1", "interval = 1e-9", "choose duration and interval"),
        ("noise = {y = 0.01}", "noise = {z = 0.01}", "noise names 'z'"),
        ("noise = {y = 0.01}", "noise = 0.01", "noise is 0.01; give a table"),
        ("noise = {y = 0.01}", "nose = {y = 0.01}", "bound has 'nose', which is unknown"),
        ("duration = 6\ninterval = 0.1", 'recording = "none.csv"', "none.csv"),
        ("m = 1}", 'm = "one"}', "values of m is 'one', which is no number"),
        ("m = 1}", "m = 0}", "the trajectory leaves the numbers"),
        ("F = 0", 'F = "cos(s)"', "'s' is unknown"),
        ("F = 0", 'F = "sqrt(t-1)"', "the course of F is nan at t = 0; change it"),
        ("F = 0", 'F = "from none.csv"', "none.csv"),
        ("[courses]\nF = 0", "", "the input 'F' has no course"),
        ("F = 0", "G = 0", "courses names 'G', which is no input"),
    ],
)
def test_wrong_numbers_are_one_line_with_the_cure(tmp_path: Path, old: str, new: str, words: str) -> None:
    text = (PUSHED + "[courses]\nF = 0\n").replace(old, new)
    with pytest.raises(InputError, match=words) as caught:
        _ = stated(tmp_path, text).last.final
    assert "\n" not in str(caught.value)
