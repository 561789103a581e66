"""The commands ``threshold``, ``polhode`` and ``reproduce``: what they write, and bad input in one line."""

import json
from pathlib import Path

import pytest

from spinfilters.cli.main import main


def test_threshold_writes_both_limits_and_says_whether_the_target_spins(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main(["threshold", "--rate-rpm", "3", "-o", str(out)]) == 0
    document = json.loads((out / "threshold.json").read_text())
    assert document["threshold_rpm"]["overall"] == pytest.approx(2.165, abs=5e-4)
    assert document["target"] == {"rate_rpm": 3.0, "regime": "spinning"}
    assert (out / "threshold.png").stat().st_size > 10_000
    assert "the target spins" in capsys.readouterr().out


def test_values_of_an_own_mission_replace_those_of_the_named_one(tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["threshold", "--mission", "orbital-express", "--radius", "3", "-o", str(out)]) == 0
    document = json.loads((out / "threshold.json").read_text())
    assert document["mission"]["station_keeping_radius"] == 3.0
    assert document["mission"]["inspector_mass"] == 900.0
    assert document["threshold_rpm"]["overall"] == pytest.approx(2 * 0.11643, rel=1e-4)


def test_polhode_draws_stability_of_a_possible_body_and_the_nearest_one_beside_an_impossible_one(
    tmp_path: Path,
) -> None:
    assert main(["polhode", "-o", str(tmp_path / "possible")]) == 0
    assert main(["polhode", "--moments", "3", "1", "0.3333", "-o", str(tmp_path / "printed")]) == 0
    pictures = [sorted(p.name for p in (tmp_path / name).glob("*.png")) for name in ("possible", "printed")]
    assert pictures == [
        ["cones.png", "polhode.png", "stability.png"],
        ["cones.png", "polhode.png", "possible.png"],
    ]
    found = json.loads((tmp_path / "possible/polhode.json").read_text())
    assert found["stability"]["y"]["verdict"] == "unstable"
    printed = json.loads((tmp_path / "printed/polhode.json").read_text())
    assert not printed["is_rigid_body"]
    assert printed["nearest_possible_moments"] == pytest.approx([1.3333, 1.0, 0.3333])
    assert any("No rigid body" in sentence for sentence in printed["text"])
    assert len((tmp_path / "printed/polhode.csv").read_text().splitlines()) > 100


def test_reproduce_goes_on_where_it_ended(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(tmp_path / "out")
    assert main(["reproduce", "tweddle-table-1.1", "-o", out]) == 0
    assert main(["reproduce", "tweddle-table-1.1", "-o", out]) == 0
    assert "tweddle-table-1.1: agrees (kept)" in capsys.readouterr().out
    assert (tmp_path / "out/reproduce.html").exists()
    assert main(["reproduce", "tweddle-table-1.1", "-o", out, "--format", "pdf", "--width", "84"]) == 0
    assert "(kept)" not in capsys.readouterr().out
    assert any((tmp_path / "out/tweddle-table-1.1").glob("*.pdf"))
    assert main(["reproduce", "list"]) == 0
    assert "tweddle-figure-2-10" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["threshold", "--mass", "-3"], "--mass"),
        (["reproduce", "list", "--width", "84"], "--format"),
        (["threshold", "--mass-fraction", "2.9"], "--mass-fraction"),
        (["polhode", "--rate-rpm", "0", "0", "0"], "give a rate"),
        (["polhode", "--moments", "1", "0", "2"], "--moments"),
        (["polhode", "--duration", "1e8"], "400 turns"),
        (["reproduce", "figure-99"], "reproduce list"),
    ],
)
def test_bad_values_are_one_line(
    words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code = main([*words, "-o", str(tmp_path / "out")])
    except SystemExit as refused:  # by the parser
        code = refused.code
    assert code == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert told in lines[0]
    assert not (tmp_path / "out").exists()
