"""Malformed dataset.toml, truth.toml and sensor.yaml of both cameras."""

from collections.abc import Iterator

from .case import Case
from .changes import added, both, bytes_of, content, lines_of, replaced, without

CAMERAS = ("cam0/sensor.yaml", "cam1/sensor.yaml")
EVERY = ("compare", "{in}", "-o", "{out}/run", "--estimators", "mekf,smoother")

_MERGES = "a0: &a0 {x0: 1}\n" + "".join(
    f"a{k}: &a{k}\n  <<: [{', '.join([f'*a{k - 1}'] * 9)}]\n  x{k}: 1\n" for k in range(1, 9)
)
_ALIASES = "a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"a{k}: &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]\n" for k in range(1, 9)
)
YAML_TEXTS = {
    "empty": "",
    "a list": "- 1\n- 2\n",
    "a number": "3\n",
    "merge keys that multiply": _MERGES,
    "aliases that multiply": _ALIASES,
    "an alias of itself": "a: &a [*a]\n",
    "a mapping that holds itself": "camera_model: &a {b: *a}\n",
    "nested without end": "a: " + "[" * 30_000,
    "mappings nested without end": "{a: " * 5000,
    "blocks nested without end": "".join(" " * k + "a:\n" for k in range(1200)),
    "dashes nested without end": "- " * 20_000,
    "an object": "a: !!python/object/apply:os.system ['true']\n",
    "a tag": "a: !secret 3\n",
    "two documents": "a: 1\n---\nb: 2\n",
    "a tab": "a:\n\t- 1\n",
    "keys that are lists": "? [1, 2]\n: 3\n",
    "an impossible date": "a: 2026-13-45\n",
    "an anchor without value": "a: *nothing\n",
    "a number of 9000 digits": "camera_model: " + "9" * 9000 + "\n",
    "sexagesimal numbers": "camera_model: " + ":".join(["59"] * 2000) + "\n",
    "a binary without end": "a: !!binary 3333\n",
    "a set": "a: !!set {b, c}\n",
    "a character of control": "a: \x07\n",
    "a quote without end": 'a: "' + "b" * 5000 + "\n",
}
INTRINSICS = {
    "1e300": "[1.0e+300, 1.0e+300, 320.0, 240.0]",
    "1e-300": "[1.0e-300, 1.0e-300, 320.0, 240.0]",
    "1e9": "[1.0e+9, 1.0e+9, 320.0, 240.0]",
    "1e-9": "[1.0e-9, 1.0e-9, 320.0, 240.0]",
    "negative": "[-466.0, -466.0, 320.0, 240.0]",
    "a far principal point": "[466.0, 466.0, 1.0e+300, 240.0]",
    "three numbers": "[466.0, 466.0, 320.0]",
    "NaN": "[.nan, 466.0, 320.0, 240.0]",
    "words": "[a, b, c, d]",
    "nothing": "",
    "a mapping": "{fx: 466.0}",
    "of 400 digits": f"[{'9' * 400}, 466.0, 320.0, 240.0]",
}
BASELINES = ("1.0e+300", "1.0e-300", "1.0e+9", "1.0e-9", "-0.09", ".inf", "'0.09x'", "true", "1e400")
RESOLUTIONS = ("[0, 0]", "[1.0e+300, 480]", "[-640, 480]", "[640.5, 480]", "[640]", "[1e18, 1e18]")
TOML_TEXTS = {
    "empty": "",
    "no kind": 'description = "x"\n',
    "kind a number": "kind = 3\n",
    "kind a list": 'kind = ["gyro"]\n',
    "kind of a megabyte": 'kind = "' + "x" * 900_000 + '"\n',
    "description a number": 'kind = "gyro"\ndescription = 3\n',
    "kind twice": 'kind = "gyro"\nkind = "pose"\n',
    "an unclosed text": 'kind = "gyro\n',
    "brackets without end": "a = " + "[" * 300_000,
    "tables without end": "a = " + "{b=" * 40_000,
    "tables of dots": "[" + "a." * 400_000 + "a]\n",
    "a million tables": "".join(f"[t{k}]\n" for k in range(90_000)),
    "a date": "kind = 2026-01-01\n",
    "a character of control": 'kind = "gyro\x07"\n',
    "a description with line feeds": 'kind = "gyro"\ndescription = "a\\nb\\u001b[2J"\n',
    "a description with a surrogate": 'kind = "gyro"\ndescription = "\\ud800"\n',
    "notes a list": 'kind = "gyro"\nnotes = [1]\n',
    "notes with a list": 'kind = "gyro"\n[notes]\na = [1]\n',
    "notes with NaN": 'kind = "gyro"\n[notes]\na = nan\n',
    "notes with a date": 'kind = "gyro"\n[notes]\na = 2026-01-01\n',
    "an unknown key": 'kind = "gyro"\ngyro_noise = 1\n',
    "a kind of images": 'kind = "stereo-images"\n',
}
STDS = ("0", "-1", "nan", "inf", "1e-300", "1e300", "1e-9", "1e9", '"x"', "true", "9" * 400)
BODIES = {
    "moments of no body": "principal_moments = [1, 1, 3]\n",
    "moments of 1e300": "principal_moments = [1e300, 1e300, 1e300]\n",
    "moments of 1e-300": "principal_moments = [1e-300, 1e-300, 1e-300]\n",
    "moments of zero": "principal_moments = [0, 0, 0]\n",
    "two moments": "principal_moments = [1, 2]\n",
    "moments in lists": "principal_moments = [[1], [2], [3]]\n",
    "axes that are no rotation": "principal_axes_g = [[1, 0, 0], [0, 1, 0], [0, 0, -1]]\n",
    "axes of 1e300": "principal_axes_g = [[1e300, 0, 0], [0, 1e300, 0], [0, 0, 1e300]]\n",
    "centre of 1e300": "center_of_mass_g = [1e300, 0, 0]\n",
    "centre of NaN": "center_of_mass_g = [nan, 0, 0]\n",
    "an unknown key": "mass = 3\n",
    "moments of words": 'principal_moments = ["a", "b", "c"]\n',
}


def calibration_cases() -> Iterator[Case]:
    """Faults of the small files of a data set."""
    yield from _yaml_cases()
    for what, text in TOML_TEXTS.items():
        yield Case(f"dataset.toml: {what}", "gyro", content("dataset.toml", text))
    stds = {"stereo": "pixel_std", "gyro": "gyro_noise_std", "pose": "pose_position_std"}
    for original, key in stds.items():
        for value in STDS:
            change = lines_of(
                "dataset.toml",
                lambda lines, key=key, value=value: [
                    f"{key} = {value}" if line.startswith(key) else line for line in lines
                ],
            )
            yield Case(f"dataset.toml: {key} = {value[:12]}", original, change)
    for what, text in BODIES.items():
        yield Case(f"truth.toml: {what}", "pose", content("truth.toml", text))
    yield Case("truth.toml: without truth.csv", "pose", without("truth.csv"))


def _yaml_cases() -> Iterator[Case]:
    for number, (what, text) in enumerate(YAML_TEXTS.items()):
        name = CAMERAS[number % 2]
        yield Case(f"{name}: {what}", "stereo", content(name, text))
        if "multiply" in what:
            yield Case(f"{name}: whole, with {what}", "stereo", added(name, text))
    for what, text in INTRINSICS.items():
        changes = [_key(name, "intrinsics", text) for name in CAMERAS]
        for original in ("stereo", "unmapped"):
            yield Case(f"{original}: intrinsics {what}", original, both(*changes), EVERY)
    for text in BASELINES:
        for original in ("stereo", "unmapped"):
            yield Case(f"{original}: baseline {text}", original, replaced(CAMERAS[1], "0.09", text), EVERY)
    for text in RESOLUTIONS:
        changes = [_key(name, "resolution", text) for name in CAMERAS]
        yield Case(f"stereo: resolution {text}", "stereo", both(*changes))
    yield Case("cam0: not UTF-8", "stereo", bytes_of(CAMERAS[0], lambda data: data + b"\xff"))
    yield Case("cam1: no T_BS", "stereo", replaced(CAMERAS[1], "T_BS", "T_SB"))
    yield Case(
        "cam1: T_BS of 1e300", "stereo", replaced(CAMERAS[1], "1.0, 0.0, 0.0, 0.09", "1e+300, 0.0, 0.0, 0.09")
    )
    yield Case("cam1: turned", "stereo", replaced(CAMERAS[1], "1.0, 0.0, 0.0, 0.09", "-1.0, 0.0, 0.0, 0.09"))
    yield Case(
        "cam0 at 1e300",
        "stereo",
        both(*[replaced(name, "0.0, 1.0, 0.0, 0.0,", "0.0, 1.0, 0.0, 1.0e+300,") for name in CAMERAS]),
    )


def _key(name: str, key: str, text: str):
    return lines_of(
        name, lambda lines: [f"{key}: {text}" if line.startswith(f"{key}:") else line for line in lines]
    )
