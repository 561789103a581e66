"""Lines of labels with numbers: one that marks the labels of the others without a number behind each is refused."""

from pathlib import Path

import pytest

import spinfilters
from spinfilters.core.errors import InputError

LINES = [f"t: {0.02 * k:.2f} gx={0.3 + 0.001 * k:.4f} gy=1.5000 gz=0.1000" for k in range(60)]


def written(folder: Path, number: int, line: str) -> Path:
    path = folder / "serial.log"
    path.write_text("\n".join([*LINES[: number - 1], line, *LINES[number:]]) + "\n")
    return path


@pytest.mark.parametrize("value", ["abc", "nan", "1.5.2", "--0.1", "0,102"])
def test_a_value_that_is_no_number_is_refused(tmp_path: Path, value: str) -> None:
    path = written(tmp_path, 9, f"t: 0.16 gx=0.3 gy={value} gz=0.1")
    with pytest.raises(
        InputError, match=rf"line 9: 'gy' is '{value}', no number; correct or delete the line"
    ):
        spinfilters.load(path, unit="rad/s")


def test_a_label_without_a_value_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="line 9: 'gy' is nothing, no number"):
        spinfilters.load(written(tmp_path, 9, "t: 0.16 gx=0.3 gy= gz=0.1"), unit="rad/s")


@pytest.mark.parametrize(
    ("number", "line"), [(60, "t: 1.18 gx=0.3 gy="), (9, "battery: v=3.7 gx calibrated: 1 gy ok")]
)
def test_a_last_line_that_was_cut_off_and_lines_of_other_things_are_left_out(
    tmp_path: Path, number: int, line: str
) -> None:
    (stream,) = spinfilters.load(written(tmp_path, number, line), unit="rad/s").log.streams
    assert len(stream.time) == len(LINES) - 1


@pytest.mark.parametrize("bad", [range(1, 11), range(51, 61)], ids=["first", "last"])
@pytest.mark.parametrize(
    "line", ["t: 0.16 gx=0.3 gy=abc gz=0.1", "t: abc gx=0.3 gy=1.5 gz=0.1", "t: 1 gx=nan gy=nan gz=nan"]
)
def test_values_that_are_no_numbers_are_refused_at_both_ends(tmp_path: Path, bad: range, line: str) -> None:
    path = tmp_path / "serial.log"
    path.write_text("\n".join(line if k in bad else text for k, text in enumerate(LINES, start=1)) + "\n")
    with pytest.raises(InputError, match=rf"line {bad.start}: '\w+' is '(abc|nan)', no number"):
        spinfilters.load(path, unit="rad/s")


@pytest.mark.parametrize("end", ["t: 1.20 gx=0.3 gy=1.5 gz=", "t: 1.20 gx=0.3 gy=1.5 gz=-"])
def test_a_legend_above_and_a_line_cut_off_below_are_left_out(tmp_path: Path, end: str) -> None:
    path = tmp_path / "serial.log"
    path.write_text("\n".join(["t: time gx=roll gy=pitch gz=yaw", *LINES, end]))
    (stream,) = spinfilters.load(path, unit="rad/s").log.streams
    assert len(stream.time) == len(LINES)


def test_a_last_number_that_was_cut_off_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "serial.log"
    path.write_text("\n".join([*LINES, "t: 1.20 gx=0.3600 gy=1.5000 gz=0.1"]))
    (stream,) = spinfilters.load(path, unit="rad/s").log.streams
    assert len(stream.time) == len(LINES)
    path.write_text("\n".join([*LINES, "t: 1.20 gx=0.3600 gy=1.5000 gz=0.1000"]))
    (stream,) = spinfilters.load(path, unit="rad/s").log.streams
    assert len(stream.time) == len(LINES) + 1
