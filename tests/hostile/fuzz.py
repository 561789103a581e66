"""Random mutations of valid inputs through the command line: ``python -m tests.hostile.fuzz --seed 0``."""

import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from .campaign import campaign, parser
from .case import Case

DATASET = ("compare", "{in}", "-o", "{out}/run", "--estimators")
TARGETS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "stereo": (
        (
            "tracks.csv",
            "cam0/sensor.yaml",
            "cam1/sensor.yaml",
            "landmarks.csv",
            "dataset.toml",
            "truth.csv",
            "truth.toml",
        ),
        DATASET,
    ),
    "unmapped": (("tracks.csv", "cam0/sensor.yaml", "cam1/sensor.yaml", "dataset.toml"), DATASET),
    "gyro": (("gyro.csv", "dataset.toml", "truth.csv"), DATASET),
    "gyro-covariance": (("gyro_covariance.csv",), DATASET),
    "pose": (("poses.tum", "dataset.toml"), DATASET),
    "pose-covariance": (("poses_covariance.csv", "poses.tum"), DATASET),
    "phone": (("Raw Data.csv", "meta/segments.csv"), (*DATASET[:2], "--segment", "1", *DATASET[2:])),
    "settings": (
        ("config.toml",),
        ("compare", "{in}/data", "--config", "{in}/config.toml", "-o", "{out}/run"),
    ),
    "run": (
        ("run/summary.json", "run/mekf/history.npz", "run/config.toml", "run/mekf/prediction.npz"),
        ("plot", "{in}/run"),
    ),
}
TOKENS = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e308",
        "-1e308",
        "1e-308",
        "0",
        "-1",
        "1e5",
        "-0.0",
        "1e999",
        "",
        " ",
        "null",
        "true",
        "[]",
    ),
    *(
        "{}",
        '"',
        "'",
        "\\",
        "\x00",
        "\x1b",
        "é",
        "9" * 60,
        "1e150",
        "1e-150",
        "&a",
        "*a",
        "<<:",
        "---",
        "#",
        "=",
        "1_0",
    ),
)
MOST_MUTATIONS = 4
_NUMBER = re.compile(rb"(?<![\w.])-?\d+\.\d+(e[+-]?\d+)?(?![\w.])")

Mutation = Callable[[np.random.Generator, bytes], bytes]


def fuzzed_cases(count: int, seed: int) -> list[Case]:
    """Mutations of the files of all originals, each decided by its number and the seed."""
    return [_case(number, seed) for number in range(count)]


def _case(number: int, seed: int) -> Case:
    generator = np.random.default_rng([seed, number])
    original = str(generator.choice(list(TARGETS)))
    files, words = TARGETS[original]
    file = str(generator.choice(files))
    if words[-1] == "--estimators":
        words = (*words, str(generator.choice(["mekf", "ukf", "smoother"])))
    return Case(
        f"fuzz {number:03d}: {original}/{file}",
        original,
        _mutated(file, generator),
        words,
        "data" if original == "run" else None,
    )


def _mutated(file: str, generator: np.random.Generator) -> Callable[[Path], object]:
    mutations = [
        MUTATIONS[k]
        for k in generator.integers(len(MUTATIONS), size=generator.integers(1, MOST_MUTATIONS + 1))
    ]
    state = generator.bit_generator.state

    def change(folder: Path) -> None:
        generator.bit_generator.state = state
        data = (folder / file).read_bytes()
        for mutation in mutations:
            data = mutation(generator, data)
        (folder / file).write_bytes(data)

    return change


def _flip_bits(generator: np.random.Generator, data: bytes) -> bytes:
    found = bytearray(data)
    for position in generator.integers(len(data), size=3) if data else ():
        found[position] ^= 1 << generator.integers(8)
    return bytes(found)


def _insert_token(generator: np.random.Generator, data: bytes) -> bytes:
    position = int(generator.integers(len(data) + 1))
    return data[:position] + _token(generator) + data[position:]


def _delete_bytes(generator: np.random.Generator, data: bytes) -> bytes:
    position = int(generator.integers(len(data) + 1))
    return data[:position] + data[position + int(generator.integers(1, 20)) :]


def _cut_off(generator: np.random.Generator, data: bytes) -> bytes:
    return data[: int(generator.integers(len(data) + 1))]


def _swap_lines(generator: np.random.Generator, data: bytes) -> bytes:
    lines = data.split(b"\n")
    one, other = generator.integers(len(lines), size=2)
    lines[one], lines[other] = lines[other], lines[one]
    return b"\n".join(lines)


def _repeat_line(generator: np.random.Generator, data: bytes) -> bytes:
    lines = data.split(b"\n")
    one = int(generator.integers(len(lines)))
    return b"\n".join([*lines[:one], lines[one], *lines[one:]])


def _delete_line(generator: np.random.Generator, data: bytes) -> bytes:
    lines = data.split(b"\n")
    del lines[int(generator.integers(len(lines)))]
    return b"\n".join(lines)


def _replace_field(generator: np.random.Generator, data: bytes) -> bytes:
    """Of a line that is parted by commas, blanks or a colon."""
    lines = data.split(b"\n")
    one = int(generator.integers(len(lines)))
    mark = next((mark for mark in (b",", b" ", b":") if mark in lines[one]), b",")
    fields = lines[one].split(mark)
    fields[int(generator.integers(len(fields)))] = _token(generator)
    lines[one] = mark.join(fields)
    return b"\n".join(lines)


def _change_number(generator: np.random.Generator, data: bytes) -> bytes:
    """Of a number somewhere, its sign, its size or a digit, so that most files stay readable."""
    numbers = list(_NUMBER.finditer(data))
    if not numbers:
        return data
    found = numbers[int(generator.integers(len(numbers)))]
    factor = float(generator.choice([-1.0, 0.0, 1e-6, 0.5, 1.001, 2.0, 10.0, 1e3, 1e6]))
    return data[: found.start()] + repr(float(found.group()) * factor).encode() + data[found.end() :]


def _token(generator: np.random.Generator) -> bytes:
    return TOKENS[int(generator.integers(len(TOKENS)))].encode()


MUTATIONS: tuple[Mutation, ...] = (
    *(_change_number,) * 10,
    *(
        _replace_field,
        _flip_bits,
        _insert_token,
        _delete_bytes,
        _cut_off,
        _swap_lines,
        _repeat_line,
        _delete_line,
    ),
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them all; exit code 1 where one did what it must not."""
    assert __doc__ is not None
    options = parser(__doc__)
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--count", type=int, default=300)
    chosen = options.parse_args(arguments)
    return campaign("tests.hostile.fuzz", fuzzed_cases(chosen.count, chosen.seed), chosen)


if __name__ == "__main__":
    raise SystemExit(main())
