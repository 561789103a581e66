"""Words that are misspelled are met with the nearest that is known, and ``-v`` tells more."""

import pytest

from spinfilters.cli.main import main


def complaint(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    try:
        code = main(list(words))
    except SystemExit as ended:
        code = int(ended.code or 0)
    assert code == 2
    return capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (("compar", "x"), "did you mean compare"),
        (("compare", "x", "--est", "mekf"), "did you mean --estimators"),
        (("compare", "x", "--estimators", "mekff"), "did you mean mekf"),
        (("simulate", "--knd", "pose"), "did you mean --kind"),
        (("compare", "x", "--set", "sensor.pixel_std=1"), "did you mean sensors"),
        (("compare", "x", "--set", "sensors.pixels_std=1"), "did you mean pixel_std"),
    ],
)
def test_the_nearest_known_word_is_named(
    words: tuple[str, ...], meant: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert meant in complaint(capsys, *words)


def test_a_long_option_is_never_abbreviated(capsys: pytest.CaptureFixture[str]) -> None:
    assert "is not for this command" in complaint(capsys, "polhode", "--moment", "1", "1", "1")


def test_verbose_tells_time_and_memory(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["schema", "settings", "--verbose"]) == 0
    told = capsys.readouterr().err
    assert "s of processor time" in told
    assert "MB of memory" in told
