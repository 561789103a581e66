"""Malformed settings files: every key with numbers out of its range, of another type, and beyond all sizes."""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass

from spinfilters.settings.run_settings import Settings

from .case import Case
from .changes import content

RUN = ("compare", "{in}/data", "--config", "{in}/config.toml", "-o", "{out}/run")
NUMBERS = (
    "-1",
    "0",
    "1e-300",
    "1e300",
    "1e-9",
    "1e9",
    "nan",
    "inf",
    "1" + "0" * 30,
    "9" * 400,
    '"x"',
    "true",
    "[]",
)
"""Of these every key gets four, in turn."""
WORDS = ("3", '""', '"' + "x" * 5000 + '"', "[]", "true")
TEXTS = {
    "nested without end": "a = " + "[" * 300_000,
    "estimators nested": 'estimators = [["mekf"]]',
    "estimators of numbers": "estimators = [1]",
    "a thousand estimators": "estimators = [" + '"mekf",' * 1000 + "]",
    "estimator of 5000 letters": 'estimators = ["' + "k" * 5000 + '"]',
    "estimator with line feeds": 'estimators = ["a\\nb"]',
    "a key of 5000 letters": "k" * 5000 + " = 1",
    "a table of 5000 letters": "[" + "k" * 5000 + "]",
    "a list of tables": "[[process]]\nforce_psd = 1",
    "empty": "",
    "only a byte order mark": "\ufeff",
    "a comment": "# nothing",
    "not TOML": "process: 3",
    "UTF-16": "[process]\nforce_psd = 1".encode("utf-16"),
    "a key with a line feed": '"a\\nb" = 1',
    "a table with an escape": '["\\u001b[2J"]',
    "no drag density": "[process]\nforce_psd = 0.0\ntorque_psd = 0.0",
    "everything of 1e-300": "[process]\nforce_psd = 1e-300\ntorque_psd = 1e-300\n[sensors]\ngyro_noise_std = 1e-300",
}


def settings_cases() -> Iterator[Case]:
    """Faults of a file that ``--config`` names."""
    turn = 0
    for table in fields(Settings):
        defaults = getattr(Settings(), table.name)
        if not is_dataclass(defaults):
            continue
        for item in fields(defaults):
            default = getattr(defaults, item.name)
            values = WORDS[turn % 2 : turn % 2 + 3] if _is_word(default) else _four(turn)
            turn += 1
            for value in values:
                yield _case(
                    f"{table.name}.{item.name} = {value[:34]}", f"[{table.name}]\n{item.name} = {value}\n"
                )
    for what, text in TEXTS.items():
        yield _case(what, text)
    yield from known_cases()


def known_cases() -> Iterator[Case]:
    """What has ended in a traceback or never."""
    for original in ("gyro", "pose", "stereo", "unmapped"):
        for text in ("[adaptation]\nmeasurement = 30", "[adaptation]\nprocess = 1e300\nmeasurement = 1e300"):
            yield _of(original, text)
        for key in ("torque_psd", "force_psd"):
            for value in ("0.0", "1e-300", "1e300"):
                yield _of(original, f"[process]\n{key} = {value}")
    for value in ("1e-9", "1e-300", "1e300", "0"):
        for original in ("stereo", "unmapped"):
            yield _of(original, f"[sensors]\npixel_std = {value}")
    for value in ("1e-9", "1e9"):
        yield _of("pose", f"[sensors]\npose_position_std = {value}\npose_rotation_std = {value}")
        yield _of("gyro", f"[sensors]\ngyro_noise_std = {value}")
    for value in ("1e-300", "1e-17", "1e300"):
        for original in ("gyro", "unmapped"):
            yield _of(original, f"[process]\ntolerance = {value}")


def _of(original: str, text: str) -> Case:
    """Settings on a data set with two filters and the smoother."""
    arguments = ("compare", "{in}", "--config", "{in}/config.toml", "-o", "{out}/run")
    whole = f'estimators = ["mekf", "ukf", "smoother"]\n{text}\n'
    return Case(
        f"{original} with {' '.join(text.split())}", original, content("config.toml", whole), arguments
    )


def _case(what: str, text: str | bytes) -> Case:
    if isinstance(text, str) and "estimators" not in text:
        text = 'estimators = ["ukf"]\n' + text
    return Case(f"config: {what}", "settings", content("config.toml", text), RUN)


def _is_word(default: object) -> bool:
    return isinstance(default, str) and default != "auto"


def _four(turn: int) -> list[str]:
    return [NUMBERS[(4 * turn + k) % len(NUMBERS)] for k in range(4)]
