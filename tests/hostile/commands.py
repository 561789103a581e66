"""Arguments of every command, and files whose names or kinds nobody expects."""

import os
from collections.abc import Iterator

from .case import Case
from .changes import Change, content, unchanged

BIG = "9" * 401
COMPARE = ("compare", "{in}", "-o", "{out}/run", "--estimators", "mekf")
SIMULATE = ("simulate", "-o", "{out}/made", "--kind", "gyro", "--frames", "5")
OBSERVE = ("observe", "-o", "{out}/made", "--sensor", "gyro", "--frames", "5")

ADDED = {
    COMPARE: (
        *(
            "--predict 1e9",
            "--predict 1e300",
            "--predict 1e-300",
            "--predict -1",
            "--predict nan",
            "--predict x",
        ),
        *(
            "--seed 3",
            f"--seed {BIG}",
            "--seed 1.5",
            "--segment -1",
            "--segment 1",
            f"--segment {BIG}",
            "--segment all",
        ),
        *(
            "--convergence",
            "--predict 1 --segment all",
            "--estimators mekf,,ukf",
            "--estimators filterpy-ekf,magic",
        ),
        *(
            "--config /dev/zero",
            "--config /dev/null",
            "--config /",
            "--config {in}",
            "--drag=1",
            "--resume=3",
            "-x",
        ),
        *(
            "-o {in}/gyro.csv",
            "-o {in}/gyro.csv/run",
            "-o {in}",
            "-o /proc/run",
            "-o /dev/null",
            "--dataset x",
            "more",
        ),
    ),
    ("estimate", "{in}", "-o", "{out}/run"): (
        *(
            "--estimator mekf,ukf,",
            "--estimator best",
            "--estimator mekf,mekf",
            "--estimators mekf",
            "--seed 3",
        ),
    ),
    ("compare", "-o", "{out}/run", "--estimators", "mekf"): (
        *(f"--seed {BIG}", "--seed -1", "--seed 1e3", "--segment all", "--segment 2", "--config {in}/none"),
    ),
    SIMULATE: (
        *(
            "--frames 0",
            "--frames -5",
            "--frames 1000000000",
            f"--frames {BIG}",
            "--frames 1e3",
            "--frames 2",
        ),
        *(
            "--interval 0",
            "--interval -1",
            "--interval 1e-300",
            "--interval 1e300",
            "--interval nan",
            "--interval x",
        ),
        *(
            "--rate-rpm 0 0 0",
            "--rate-rpm 1e300 0 0",
            "--rate-rpm 1e9 0 0",
            "--rate-rpm 1 2",
            "--rate-rpm a b c",
        ),
        *(
            "--moments 1e300 1e300 1e300",
            "--moments 1e-300 1e-300 1e-300",
            "--moments 0 0 0",
            "--moments 1 1 2",
        ),
        *(
            "--moments 1 1 1e-300",
            "--moments 1 1 1e-9",
            "--moments 1 1 3",
            "--moments -1 -1 -1",
            "--moments inf 1 1",
        ),
        *(
            f"--seed {BIG}",
            "--seed -1",
            "--seed 0x10",
            "--kind radar",
            "--kind ''",
            "-o {in}",
            "-o {in}/gyro.csv",
        ),
        *(
            "--kind stereo-tracks --interval 1e-300",
            "--kind pose --moments 1e300 1e300 1e300",
            "-o /proc/made",
        ),
        *("--interval 1e6", "--interval 1e6 --rate-rpm 0 0 0", "--rate-rpm 600 0 0 --interval 10", "more"),
    ),
    OBSERVE: (
        *(
            "--frames 0",
            "--frames -1",
            "--frames 1000000000",
            f"--frames {BIG}",
            "--interval 0",
            "--interval 1e300",
        ),
        *(
            "--interval 1e-300",
            "--rate-rpm 1e300 0 0",
            "--rate-rpm 1e-300 0 0",
            "--rate-rpm 0 0 0",
            "--rate-rpm x 0 0",
        ),
        *(
            "--moments 1e300 1e300 1e300",
            "--moments 1e-300 1e-300 1e-300",
            "--moments 0 0 0",
            "--moments 1 1 3",
        ),
        *(
            "--moments 1 1 2",
            "--moments 1 1 1e-9",
            "--moments 1 1e-300 1",
            "--landmarks 0",
            "--landmarks 1000000000",
        ),
        *(
            "--landmarks -3",
            f"--landmarks {BIG}",
            "--sensor lidarr",
            "--sensor ''",
            "--chart x",
            "--torque a",
        ),
        *(
            "--torque",
            "--torque x x x x",
            "--manoeuvre z z",
            "--known-map=1",
            "-o {in}",
            "-o {in}/gyro.csv",
            "more",
        ),
        *(
            "--sensor stereo --landmarks 1",
            "--sensor monocular --landmarks 1 --rate-rpm 0 0 0",
            "--interval nan",
        ),
    ),
    ("plot",): ("", "{in}", "{in}/gyro.csv", "{in}/nothing", "/dev/zero", "{in} more", "''"),
    ("doctor",): ("more", "--fast", "{in}"),
    (): ("", "guess", "-h=3", "--version=1", "compare compare compare", "--", "-"),
}


def command_cases() -> Iterator[Case]:
    """Faults of arguments and of names."""
    for words, extras in ADDED.items():
        for extra in extras:
            given = [part.replace("''", "") for part in extra.split()]
            command = " ".join(word for word in words if word not in ("-o", "{out}/run", "{out}/made"))
            what = f"{command} {extra if len(extra) < 60 else f'{extra[:50]}...'}".strip()
            yield Case(f"arguments: {what or '(none)'}", "gyro", unchanged, (*words, *given))
    for what, (change, path) in _names().items():
        yield Case(
            f"name: {what}", "gyro", change, ("compare", path, "-o", "{out}/run", "--estimators", "mekf")
        )
        yield Case(f"name: config {what}", "gyro", change, (*COMPARE, "--config", path))
        yield Case(f"name: plot {what}", "gyro", change, ("plot", path))
    for what, name in {
        "not UTF-8": "a\udcffb",
        "with a line feed": "a\nb",
        "of blanks": "  ",
        "long": "r" * 300,
    }.items():
        yield Case(
            f"name: run {what}", "gyro", unchanged, (*COMPARE[:2], "-o", "{out}/" + name, *COMPARE[4:])
        )
        yield Case(
            f"name: simulated {what}", "gyro", unchanged, ("simulate", "-o", "{out}/" + name, *SIMULATE[3:])
        )
        yield Case(
            f"name: observed {what}", "gyro", unchanged, ("observe", "-o", "{out}/" + name, *OBSERVE[3:])
        )


def _names() -> dict[str, tuple[Change, str]]:
    """What makes a file, and the path that is given."""
    table = "time_s,wx,wy,wz\n" + "".join(f"{0.1 * k:.1f},1,{0.1 * k},0.3\n" for k in range(20))
    named = {
        "not UTF-8": "a\udcffb.csv",
        "with a line feed": "a\nb.csv",
        "with an escape": "a\x1b[2Jb.csv",
        "with braces": "a{b}[c].csv",
        "with a leading dash": "-a.csv",
        "long": "a" * 250 + ".csv",
        "with markup": "[red]a[bold].csv",
    }
    made = {what: (content(name, table), "{in}/" + name) for what, name in named.items()}
    return made | {
        "with NUL": (unchanged, "{in}/a\0b.csv"),
        "too long": (unchanged, "{in}/" + "a" * 5000),
        "nothing": (unchanged, ""),
        "a device": (unchanged, "/dev/zero"),
        "a process": (unchanged, "/proc/self/mem"),
        "a folder without end": (lambda folder: (folder / "loop").symlink_to(folder / "loop"), "{in}/loop"),
        "a pipe": (lambda folder: os.mkfifo(folder / "pipe.csv"), "{in}/pipe.csv"),
        "a broken link": (lambda folder: (folder / "b.csv").symlink_to("nowhere"), "{in}/b.csv"),
        "an archive": (content("a.zip", b"PK\x03\x04"), "{in}/a.zip"),
    }
