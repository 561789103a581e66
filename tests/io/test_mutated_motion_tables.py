"""Two hundred motion tables that are damaged at random are read, or refused in one line; nothing else happens."""

import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from spinfilters.core.errors import InputError
from spinfilters.run.readers import read_dataset

HEADERS = (
    "time_s,wx,wy,wz",
    "Time (s),Gyroscope x (rad/s),Gyroscope y (rad/s),Gyroscope z (rad/s)",
    "time,gyroX,gyroY,gyroZ",
    "t_ms,gyr_x_dps,gyr_y_dps,gyr_z_dps",
    "time_s,ax,ay,az,wx,wy,wz",
    "t_s,px_m,py_m,pz_m,qw,qx,qy,qz",
)
CELLS = ("nan", "-inf", "1e999", "1e300", "", "abc", "0x10", "1_0", "1,5", "١", "\x1b[31m", '"')
Rows = list[list[str]]
Mutation = Callable[[Rows, np.random.Generator], Rows]


def table(header: str) -> Rows:
    """Forty rows that are well."""
    names = header.split(",")
    row = ["1"] * len(names) if "qw" not in names else ["0.1", "0", "0", "1", "0", "0", "0"]
    return [names, *([f"{0.01 * k:.2f}", *row[-len(names) + 1 :]] for k in range(40))]


def with_cell(rows: Rows, generator: np.random.Generator) -> Rows:
    """Another cell somewhere, the header not spared."""
    row = rows[generator.integers(len(rows))]
    row[generator.integers(len(row))] = str(generator.choice(CELLS))
    return rows


def with_clock(factor: float, shift: float) -> Mutation:
    """The clock in another unit, or from another origin."""
    return lambda rows, _: [rows[0], *([repr(shift + factor * float(t)), *rest] for t, *rest in rows[1:])]


MUTATIONS: tuple[Mutation, ...] = (
    with_cell,
    with_cell,
    lambda rows, _: rows[:1],
    lambda rows, _: rows[:2],
    lambda rows, _: rows[1:],
    lambda rows, _: [rows[0], *rows[:0:-1]],
    lambda rows, generator: [*rows, rows[generator.integers(1, len(rows))]],
    lambda rows, _: [rows[0], *rows[1:], rows[-1][:-1]],
    lambda rows, _: [*rows, [*rows[-1], "7"]],
    lambda rows, generator: [list(generator.permutation(rows[0])), *rows[1:]],
    lambda rows, _: [rows[0], *(["0"] * len(row) for row in rows[1:])],
    lambda rows, _: [rows[0], *([row[0], *(each + "e3" for each in row[1:])] for row in rows[1:])],
    with_clock(1e9, 0.0),
    with_clock(1e6, 0.0),
    with_clock(1.0, 1.7e9),
    with_clock(0.0, 5.0),
)


def encoded(text: str, generator: np.random.Generator) -> bytes:
    """Bytes of a text, which one in three times are damaged."""
    whole = text.encode()
    damaged = (
        whole[: generator.integers(len(whole))],
        b"\xef\xbb\xbf" + whole,
        text.encode("utf-16"),
        text.encode("utf-16")[:-1],
        whole.replace(b"\n", b"\r\n"),
        whole.replace(b"\n", b"\r"),
        whole.replace(b",", b";"),
        whole[:50] + b"\xb5" + whole[50:],
        whole[:50] + b"\0" + whole[50:],
        generator.bytes(300),
        whole + b"9" * (2**20 + 10),
    )
    return damaged[generator.integers(len(damaged))] if generator.random() < 0.33 else whole


@pytest.mark.parametrize("seed", range(6))
def test_a_mutated_table_is_read_or_refused_in_one_line(seed: int, tmp_path: Path) -> None:
    generator = np.random.default_rng(seed)
    path, refused = tmp_path / "mine.csv", 0
    for _ in range(50):
        rows = table(HEADERS[generator.integers(len(HEADERS))])
        rows = MUTATIONS[generator.integers(len(MUTATIONS))](rows, generator)
        path.write_bytes(encoded("\n".join(map(",".join, rows)) + "\n", generator))
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                dataset = read_dataset(path)
        except InputError as error:
            message = str(error)
            assert message.startswith(str(path))
            assert message.isprintable()
            assert ";" in message
            assert len(message) - len(str(path)) < 280
            refused += 1
        else:
            assert np.median(np.diff(dataset.log.times)) == pytest.approx(0.01, rel=0.01) or "clock in" in (
                dataset.description
            )
    assert 20 < refused < 50
