"""Data sets of the right format whose motion or noise cannot be: random poses, rates beyond all, gaps of years."""

from collections.abc import Callable, Iterator

import numpy as np

from .case import Case
from .changes import Change, column, content

EVERY = ("compare", "{in}", "-o", "{out}/run", "--estimators", "mekf,ukf,smoother")
FILES = ("compare", "{in}/made", "-o", "{out}/run", "--estimators", "mekf,ukf,smoother")

Rates = Callable[[np.ndarray], np.ndarray]
GYROS: dict[str, tuple[np.ndarray, Rates]] = {
    "at rest": (np.arange(40) * 0.1, lambda t: np.zeros((t.size, 3))),
    "of random rates": (
        np.arange(40) * 0.1,
        lambda t: np.random.default_rng(1).normal(size=(t.size, 3)) * 30,
    ),
    "at 1e5 rad/s": (np.arange(40) * 0.1, lambda t: np.tile([1e5, 1e4, 1e3], (t.size, 1))),
    "at 1e9 rad/s": (np.arange(40) * 0.1, lambda t: np.tile([1e9, 1e9, 1e3], (t.size, 1))),
    "at 1e160 rad/s": (np.arange(40) * 0.1, lambda t: np.tile([1e160, 1e150, 1.0], (t.size, 1))),
    "at 1e-200 rad/s": (np.arange(40) * 0.1, lambda t: np.tile([1e-200, 1e-210, 0.0], (t.size, 1))),
    "at 34.8 rad/s": (np.arange(40) * 0.01, lambda t: np.tile([34.8, 1.0, 0.5], (t.size, 1))),
    "one sample of 1e5 rad/s": (
        np.arange(40) * 0.1,
        lambda t: np.where(np.arange(t.size)[:, None] == 30, 1e5, [0.4, 1.0, 0.3]),
    ),
    "one sample of 1e5 rad/s at the start": (
        np.arange(40) * 0.1,
        lambda t: np.where(np.arange(t.size)[:, None] == 2, 1e5, [0.4, 1.0, 0.3]),
    ),
    "every 1e6 s": (np.arange(12) * 1e6, lambda t: np.tile([0.4, 1.0, 0.3], (t.size, 1))),
    "every 1e-9 s": (np.arange(40) * 1e-9, lambda t: np.tile([0.4, 1.0, 0.3], (t.size, 1))),
    "with a gap of 1e6 s": (
        np.arange(40) * 0.1 + 1e6 * (np.arange(40) > 30),
        lambda t: np.tile([0.4, 1.0, 0.3], (t.size, 1)),
    ),
    "in degrees a second": (
        np.arange(60) * 0.01,
        lambda t: np.degrees(np.stack([np.sin(t * 20), 9 + 0 * t, np.cos(t * 20)], axis=1)),
    ),
    "at epochs of 1e9 s": (1.7e9 + np.arange(40) * 0.1, lambda t: np.tile([0.4, 1.0, 0.3], (t.size, 1))),
    "about a fixed axis": (np.arange(40) * 0.1, lambda t: np.tile([0.0, 1.0, 0.0], (t.size, 1))),
}


def motion_cases() -> Iterator[Case]:
    """Motions that no body makes, and those at the edge."""
    for what, (time, rates) in GYROS.items():
        table = _table("time_s,wx,wy,wz", np.column_stack([time, rates(time)]), ",")
        named = tuple(word.replace("made", "made.csv") for word in FILES)
        yield Case(f"gyro {what}", "gyro", content("made.csv", table), named, pictures=True)
    for what, change in _poses().items():
        yield Case(
            f"poses {what}",
            "pose",
            change,
            tuple(word.replace("made", "made.tum") for word in FILES),
            pictures=True,
        )
    for factor in (1e-12, 1e-3, 1e3, 1e12):
        yield Case(f"map times {factor}", "stereo", _scaled_map(factor), EVERY, pictures=True)
    for name in ("stereo", "unmapped"):
        yield Case(f"{name} of random pixels", name, _random_pixels(), EVERY, pictures=True)
        yield Case(
            f"{name} without disparity", name, column("tracks.csv", 4, lambda *_: 320.0), EVERY, pictures=True
        )


def _poses() -> dict[str, Change]:
    generator = np.random.default_rng(2)
    time = np.arange(20) * 0.5
    still = np.tile([0.0, 0, 0, 1], (20, 1))
    turning = np.stack([0 * time, np.sin(0.4 * time), 0 * time, np.cos(0.4 * time)], axis=1)
    random = generator.normal(size=(20, 4))
    random /= np.linalg.norm(random, axis=1, keepdims=True)
    places = generator.normal(size=(20, 3))
    motions = {
        "at random positions": (places, turning),
        "at random positions and attitudes": (places, random),
        "at positions of 1e150": (places * 1e150, turning),
        "at positions of 1e300": (places * 1e300, turning),
        "at positions of 1e9": (places * 1e9, turning),
        "at positions of 1e-300": (places * 1e-300, turning),
        "at rest": (0 * places, still),
        "that jump once": (np.where(np.arange(20)[:, None] == 12, 1e6, 0.0) + 0 * places, turning),
        "turned by half a revolution each": (
            0 * places,
            turning * np.where(np.arange(20) % 2, -1, 1)[:, None],
        ),
    }
    return {
        what: content("made.tum", _table("# poses", np.column_stack([time, *motion]), " "))
        for what, motion in motions.items()
    }


def _scaled_map(factor: float) -> Change:
    def change(folder):
        for index in (1, 2, 3):
            column("landmarks.csv", index, lambda value, _: value * factor)(folder)

    return change


def _random_pixels() -> Change:
    def change(folder):
        generator = np.random.default_rng(3)
        column("tracks.csv", 2, lambda *_: float(generator.uniform(320, 640)))(folder)
        column("tracks.csv", 3, lambda *_: float(generator.uniform(0, 480)))(folder)
        column("tracks.csv", 4, lambda *_: float(generator.uniform(0, 320)))(folder)

    return change


def _table(header: str, rows: np.ndarray, delimiter: str) -> str:
    return "\n".join([header, *(delimiter.join(map(repr, row)) for row in rows.tolist())]) + "\n"
