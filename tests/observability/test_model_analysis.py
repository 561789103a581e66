"""An analysis of a user's equations says what is observable, proved or open, in words, JSON, HTML and at the command line."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import casadi as ca
import pytest

import observability
from observability import analyse, analyse_file
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError

SPRING = """
name = "a damped spring"
states = ["x", "v"]
parameters = ["k", "m", "d"]
[equations]
x = "v"
v = "-(k*x + d*v)/m"
[outputs]
y = "x"
"""


@pytest.fixture
def spring(tmp_path: Path) -> Path:
    path = tmp_path / "spring.toml"
    path.write_text(SPRING)
    return path


def test_a_file_is_analysed(spring: Path) -> None:
    found = analyse_file(spring)
    assert (found.rank, found.dimension, found.order) == (4, 5, 3)
    assert found.observable == {"k": False, "m": False, "d": False, "x": True, "v": True}
    assert found.certified
    assert "Not observable: k, m, d (1 direction)." in str(found)
    assert "No output notices k -> e^ε k, m -> e^ε m, d -> e^ε d (scaling)." in str(found)


def test_expressions_are_analysed_in_five_lines() -> None:
    x, k = ca.SX.sym("x", 2), ca.SX.sym("k")
    found = analyse(ca.vertcat(x[1], -k * x[0]), x[0], x, parameters=k)
    assert found.unobservable == ()
    assert "Proof: the exact rank is full." in found.sentences


def test_a_special_point_is_certified_by_what_stays_and_compared_with_generic_ones() -> None:
    x, k = ca.SX.sym("x", 2), ca.SX.sym("k")
    found = analyse(ca.vertcat(x[1], -k * x[0]), x[0], x, parameters=k, at={"x_0": 0, "x_1": 0})
    assert found.proof.name == "MANIFOLD"
    assert found.unobservable == ("k",)
    assert found.generic_rank == 3
    assert "generic points nearby have rank 3" in str(found)


def test_a_special_point_without_generators_is_open() -> None:
    document = {
        "states": ["x", "z"],
        "parameters": ["a"],
        "equations": {"x": "z*a + x", "z": "1"},
        "outputs": {"y": "x**3"},
    }
    found = analyse(document, at={"x": 0, "z": 0, "a": 0})
    assert not found.certified
    assert "at least rank" in str(found)
    assert "Proof: open" in str(found)


def test_a_known_initial_value_that_stays_leaves_a_generic_model() -> None:
    document = {
        "states": ["a", "b"],
        "parameters": ["k", "l"],
        "equations": {"a": "-k*a", "b": "k*a - l*b"},
        "outputs": {"y": "b"},
    }
    assert analyse(document).unobservable == ()
    found = analyse(document | {"known_initial_values": {"a": 0}})
    assert found.unobservable == ("k",)
    assert found.proof.name == "GENERIC"


def test_what_no_output_depends_on_is_named() -> None:
    document = {
        "states": ["x", "z"],
        "parameters": ["a", "b"],
        "equations": {"x": "-a*x", "z": "b*x"},
        "outputs": {"y": "x"},
    }
    found = analyse(document)
    assert found.unreached == ("b", "z")
    assert "No output depends on b, z." in str(found)
    assert found.generators == [{"b": "1"}, {"z": "1"}]


def test_the_document_and_the_page_say_the_same(spring: Path) -> None:
    found = analyse_file(spring)
    document = json.loads(json.dumps(found.document()))
    assert document["rank"] == 4
    assert document["observable"]["x"]
    assert "<td>x</td><td>observable</td>" in found._repr_html_()


def test_the_command_writes_what_it_prints(
    spring: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "found"
    assert main(["observe", str(spring), "-o", str(folder)]) == 0
    assert "Observable: x, v." in capsys.readouterr().out
    assert "Observable: x, v." in (folder / "observe.txt").read_text()
    assert json.loads((folder / "observability.json").read_text())["rank"] == 4


def test_the_command_titles_its_answer_by_the_name_in_the_file(
    spring: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = [line for line in spring.read_text().splitlines() if not line.startswith("name")]
    spring.write_text("\n".join(['name = "a spring\\u001b[31m"', *lines]))
    assert main(["observe", str(spring), "-o", str(tmp_path / "found")]) == 0
    assert f"{spring.name} (a spring\\x1b[31m): of 5 unknowns" in capsys.readouterr().out


def test_the_command_prints_formulas_on_demand(
    spring: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "found"
    assert main(["observe", str(spring), "--symbols", "-o", str(folder)]) == 0
    assert "L2 y = -(d*v + k*x)/m" in capsys.readouterr().out
    document = json.loads((folder / "observability.json").read_text())
    assert document["observability_matrix"]["rows"][1]["gradient"] == {"v": "1"}
    assert document["symbolic_null_vectors"] == [{"k": "k/d", "m": "m/d", "d": "1"}]
    assert document["reparametrisation"]["equations"]["v"] == "-d*v - k*x"
    assert main(["observe", "--symbols", "-o", str(tmp_path / "body")]) == 2
    assert "give a model's file" in capsys.readouterr().err


def test_the_command_searches_other_solutions_on_demand(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "decay.toml"
    path.write_text('states = ["x"]\nparameters = ["k"]\n[equations]\nx = "-k**2*x"\n[outputs]\ny = "x"\n')
    assert main(["observe", str(path), "--solutions", "-o", str(tmp_path / "found")]) == 0
    assert "Another solution: where k = " in capsys.readouterr().out
    document = json.loads((tmp_path / "found" / "observability.json").read_text())
    assert document["isolated_solutions"]["ambiguous"] == ["k"]


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("model.py", "x = 1", "write it as model.toml"),
        ("model.toml", "states = [", "is not TOML"),
        ("model.toml", SPRING.replace('x = "v"', ""), "the state 'x' has no equation"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, text: str, words: str
) -> None:
    (tmp_path / name).write_text(text)
    assert main(["observe", str(tmp_path / name), "-o", str(tmp_path / "found")]) == 2
    complaint = capsys.readouterr().err
    assert words in complaint
    assert complaint.count("\n") <= 1
    assert not (tmp_path / "found").exists()


@pytest.mark.parametrize(
    "option", [("--sensor", "gyro"), ("--torque", "x"), ("--moments", "3", "2", "1"), ("--landmarks", "7")]
)
def test_options_of_a_tumbling_body_are_refused_beside_a_model(
    spring: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], option: tuple[str, ...]
) -> None:
    assert main(["observe", str(spring), *option, "-o", str(tmp_path / "found")]) == 2
    assert f"{option[0]} is of a tumbling body; leave it out" in capsys.readouterr().err


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file; check the path"):
        analyse_file(tmp_path / "none.toml")


def test_importing_the_package_loads_nothing_heavy() -> None:
    program = "import sys, observability; print(sorted({'casadi', 'numpy', 'scipy'} & set(sys.modules)))"
    found = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


def test_unknown_names_of_the_package_are_attribute_errors() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        getattr(observability, "noth" + "ing")


def test_equations_and_outputs_may_be_two_dictionaries() -> None:
    spring = {"x": "v", "v": "-k*x/m"}
    found = analyse(spring, {"y": "x"}, parameters=["k", "m"], name="spring")
    whole = {"states": ["x", "v"], "parameters": ["k", "m"], "equations": spring, "outputs": {"y": "x"}}
    assert found.document() == analyse(whole, name="spring").document()
    assert analyse(spring, {"y": "x"}, parameters=["k", "m"], at={"x": 0, "v": 0}).rank == 2


@pytest.mark.parametrize(
    ("f", "roles", "complaint"),
    [
        ({"x": "v", "v": "-k*x"}, {}, "'k'"),
        ({"x": "v", "v": "-k*x"}, {"parameter": ["k"]}, "'parameter' is no role of names"),
        ({"equations": {"x": "1"}, "states": ["x"]}, {}, "give it alone"),
    ],
)
def test_wrong_equations_by_state_are_told(f: dict[str, Any], roles: dict[str, Any], complaint: str) -> None:
    with pytest.raises(InputError, match=complaint):
        analyse(f, {"y": "x"}, **roles)
