"""Files that are well formed and hold measurements that no estimator can use: the refusal names them."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from tests.cli.faults import refusal

Rates = Callable[[float], Sequence[float]]
TUMBLING: Rates = lambda t: (0.1, 1 + 0.1 * math.sin(t), 0.05)  # noqa: E731
TENTHS = [0.1 * k for k in range(60)]


def gyro(times: Sequence[float], rates: Rates = TUMBLING) -> str:
    """Text of a gyro file."""
    lines = [",".join(map(repr, (float(t), *map(float, rates(t))))) for t in times]
    return "\n".join(["time_s,wx,wy,wz", *lines]) + "\n"


def poses(count: int, rate: float, interval: float = 0.5) -> str:
    """Text of a TUM file of a body that turns about y."""
    halves = [(interval * k, rate * interval * k / 2) for k in range(count)]
    return "".join(f"{t} 0 0 1 0 {math.sin(a)} 0 {math.cos(a)}\n" for t, a in halves)


UNUSABLE = {
    "gap.csv": (gyro([*TENTHS, *(1e6 + t for t in TENTHS)]), "times from t = 5.9 s to 1000000 s"),
    "spike.csv": (gyro([*TENTHS, 1e7, *(1e7 + 1 + t for t in TENTHS)]), "times from t = 5.9 s to 10000000 s"),
    "fast.csv": (
        gyro(TENTHS, lambda t: (0.1, 1e4 if abs(t - 3.0) < 0.01 else 1.0, 0.0)),
        "line 32: a rate of 1e+04 rad/s",
    ),
    "rest.csv": (gyro(TENTHS, lambda t: (0, 0, 0)), "does not rotate"),
    "constant.csv": (
        gyro(TENTHS, lambda t: (1, 2, 3)),
        "rates never change, so its noise cannot be distinguished from",
    ),
    "one.csv": (gyro(TENTHS[:1]), "has 1 epoch, a motion needs at least 5"),
    "short.csv": (gyro(TENTHS[:3]), "has 3 epochs, a motion needs at least 5"),
    "four.csv": (gyro(TENTHS[:4]), "has 4 epochs, a motion needs at least 5"),
    "rest.tum": (poses(40, 0.0), "does not rotate"),
    "short.tum": (poses(3, 1.0), "has 3 epochs, a motion needs at least 5"),
    "fast.tum": (
        poses(40, 6.0),
        "are more than 126 deg from their neighbours (172 deg at t = 0.000 s)",
    ),
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_a_refusal_of_measurements_names_their_file(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, says = UNUSABLE[name]
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    said = refusal(capsys, "compare", str(path), "-o", str(tmp_path / "run"))
    assert said.startswith(f"spinfilters: {path}: ")
    assert said.count(str(path)) == 1
    assert says in said
    assert not (tmp_path / "run").exists()


def test_a_recording_that_the_start_uses_up_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "all.toml").write_text("[initialisation]\nshare = 1.0\nframes = 1000\n", encoding="utf-8")
    path = tmp_path / "five.tum"
    path.write_text(poses(5, 1.0), encoding="utf-8")
    arguments = (str(path), "-o", str(tmp_path / "run"), "--config", str(tmp_path / "all.toml"))
    said = refusal(capsys, "compare", *arguments)
    assert said.startswith(f"spinfilters: {path}: no epoch is left")
