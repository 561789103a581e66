"""What every command line has: exact flags, a hint at what was meant, settings by key, output for people and for programs."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import spinfilters
from spinfilters.cli.commands import COMMANDS
from spinfilters.cli.main import main
from spinfilters.core.errors import InputError
from spinfilters.settings.run_settings import Settings, read_settings, with_keys


@pytest.fixture
def table(tmp_path: Path) -> str:
    """A short gyro table."""
    stream = spinfilters.simulate("gyro", frames=30, seed=1).log.streams[0]
    path = tmp_path / "mine.csv"
    rows = np.column_stack([stream.time, stream.values]).tolist()
    path.write_text("time_s,wx,wy,wz\n" + "".join(",".join(map(repr, row)) + "\n" for row in rows))
    return str(path)


@pytest.mark.parametrize(
    ("words", "hint"),
    [
        (["compar"], "did you mean compare"),
        (["compare", "--estimator", "mekf"], "did you mean --estimators"),
        (["compare", "--resum"], "did you mean --resume"),
        (["campain", "study.toml"], "did you mean campaign"),
    ],
)
def test_a_misspelled_word_is_met_with_the_nearest(
    words: list[str], hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    assert hint in capsys.readouterr().err


def test_the_help_lists_every_command_once_in_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    lines = capsys.readouterr().out.splitlines()
    for listed in COMMANDS:
        assert sum(line.startswith(f"  {listed.name} ") for line in lines) == 1
    groups = [line.removesuffix(":") for line in lines if line.endswith(":")]
    assert groups[2:] == [*dict.fromkeys(listed.group for listed in COMMANDS)]


def test_keys_of_settings_are_set_by_name() -> None:
    changed = with_keys(
        Settings(), ["sensors.gyro_noise_std=0.02", "process.drag=linear", 'estimators=["ukf"]']
    )
    assert changed.sensors.gyro_noise_std == 0.02
    assert changed.process.drag == "linear"
    assert changed.estimators == ("ukf",)
    assert with_keys(Settings(), ["initialisation.mean.rate=[0, 0, 1]"]).initialisation.mean == {
        "rate": [0, 0, 1]
    }


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sensors.pixel_std", "is no setting; give KEY=VALUE"),
        ("sensors.pixel_std=", "is no setting"),
        ("sensors.smell=1", "unknown key sensors.smell"),
        ("sensors.pixel_std=-1", "sensors.pixel_std is -1"),
        ("verdict.deep=1", "verdict is no table"),
        ("a.b.c.d.e=1", "is no setting"),
    ],
)
def test_a_key_that_cannot_be_set_is_refused(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        with_keys(Settings(), [text])


PRINTING_ALONE = {"schema", "completion", "doctor", "campaign merge"}
"""Commands whose output is all that they make, and one of earlier versions."""


def test_every_command_that_makes_something_takes_the_common_options() -> None:
    named = [each for listed in COMMANDS for each in listed.load().parts]
    without = {words for words, command in named if command.common is None}
    assert without == PRINTING_ALONE
    for words, command in named:
        flags = {each.flag for each in command.fields}
        assert words in PRINTING_ALONE or {"--quiet", "--json"} <= flags


SETTINGS = ("compare", "estimate", "live", "observe")
"""Commands that estimate or judge with settings."""


def test_every_command_with_settings_takes_single_ones_too() -> None:
    named = [each for listed in COMMANDS for each in listed.load().parts]
    for flag in ("--config", "--set"):
        taking = [words for words, command in named if flag in {each.flag for each in command.fields}]
        assert taking == list(SETTINGS)


@pytest.mark.parametrize(
    ("words", "key"),
    [
        ("polhode -o out", "kind"),
        ("threshold -o out", "threshold_rpm"),
        ("rig", "std_m"),
        ("simulate -o out --kind gyro --frames 20", "measurements"),
        ("observe --sensor gyro -o out --frames 5", "rank"),
        ("study list", None),
        ("reproduce list", None),
    ],
)
def test_a_command_prints_its_result_as_json_draws_nothing_or_is_quiet(
    words: str,
    key: str | None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    plain = ["--no-figures"] if "-o" in words else []
    assert main([*words.split(), "--json", *plain]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document
    assert key is None or key in document
    assert list(tmp_path.rglob("*.png")) == []
    assert main([*words.split(), "-q", *plain]) == 0
    said = capsys.readouterr()
    assert said.out + said.err == ""


def test_a_live_run_prints_its_counts_as_json_and_takes_the_settings_of_its_folder(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["live", table, "--speed", "1e6", "--no-smoother", "--no-figures", "--summary", "live.json"]
    main([*words, "--json", "--deadline-ms", "1e6"])
    said = capsys.readouterr()
    assert json.loads(said.out) == json.loads((tmp_path / "live.json").read_text())
    assert said.err == ""
    assert not (tmp_path / "live.png").exists()
    (tmp_path / "spinfilters.toml").write_text("[sensors]\nsmell = 1\n")
    assert main(words) == 2
    assert "sensors.smell" in capsys.readouterr().err
    (tmp_path / "spinfilters.toml").unlink()
    assert main([*words, "--set", "sensors.smell=1"]) == 2


@pytest.mark.parametrize("words", [["compare"], ["track", "-o", "tracks"]])
def test_something_is_shown_before_the_first_image_is_read(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for camera in ("cam0", "cam1"):
        (tmp_path / "images" / camera / "data").mkdir(parents=True)
    shown: list[str] = []

    @contextmanager
    def bars() -> Iterator[Any]:
        yield lambda name, done, total: shown.append(name)

    def read(*_: object) -> None:
        assert shown == ["reading"]
        raise InputError("no more than that")

    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    monkeypatch.setattr("spinfilters.cli.console.progress_bars", bars)
    monkeypatch.setattr("spinfilters.vision.track_images.stamped_pairs", read)
    assert main([words[0], "images", *words[1:]]) == 2
    assert shown == ["reading"]


def test_numbers_alone_are_written_and_printed_for_programs(
    table: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "spinfilters.toml").write_text('estimators = ["mekf"]\nverdict = "filter"\n')
    options = ["--no-figures", "--json", "--set", "sensors.gyro_noise_std=0.01", "-o", "run"]
    assert main(["compare", table, *options]) == 0
    assert list(json.loads(capsys.readouterr().out)["estimators"]) == ["mekf"]
    assert not list((tmp_path / "run").rglob("*.png"))
    settings = read_settings(tmp_path / "run" / "config.toml")
    assert settings.sensors.gyro_noise_std == 0.01
    assert settings.verdict == "filter"
    assert main(["compare", table, "--no-figures", "-q", "-o", "run"]) == 0
    assert capsys.readouterr().out == ""
    assert main(["compare", table, "--no-figures", "-o", "other"]) == 0
    assert "report.html" not in capsys.readouterr().out
