"""Disks that are full: every file that a command writes ends at a length, as do its printed lines.

python -m tests.hostile.full_disks [--only TEXT] [--verbose]
"""

from collections.abc import Iterator, Sequence

from .campaign import campaign, parser
from .case import Case
from .changes import content

LENGTHS = (1_000, 20_000)
"""Bytes after which a file ends; longer than what a command says on standard error."""
STUDY = """
[study]
name = "full"
seeds = 2
bound = "none"
[factors]
estimator = ["mekf"]
[motion.base]
rate_rpm = [4.0, 9.0, 3.0]
epochs = 40
[sensor.base]
kind = "gyro"
"""
COMMANDS = (
    "compare {in}/data -o {out}/run --estimators mekf --predict 1",
    "compare {in}/data -o {in}/run --estimators mekf --resume",
    "compare {in}/data -o {out}/run --estimators mekf --json",
    "estimate {in}/data -o {out}/run --estimator smoother",
    "segments {in}/data",
    "plot {in}/run -o {out}/drawn --figures rates",
    "simulate -o {out}/data --frames 20",
    "lidar scan cube -o {out}/scan --rays 30 30",
    "lidar scan cube -o {out}/scans --rays 20 20 --scans 2",
    "observe --sensor gyro -o {out}/observed",
    "observe --recording {in}/data -o {out}/observed",
    "condition --time-step 0.5 -o {out}/condition",
    "polhode --moments 3 2 1 -o {out}/polhode",
    "reproduce tweddle-table-1.1 decoust-figure-2.5 -o {out}/made",
    "embed -o {out}/filter",
    "campaign {in}/study.toml -o {out}/rows --workers 1",
    "live {in}/data --speed 1e6 --no-smoother --summary {out}/summary.json",
    "doctor",
)


def full_disk_cases() -> Iterator[Case]:
    """Every command at every length."""
    for words in COMMANDS:
        for length in LENGTHS:
            yield Case(
                f"files of {length} bytes: {words}",
                "run",
                content("study.toml", STUDY),
                words.split(),
                keeps="data",
                pictures=True,
                file_bytes=length,
            )


def main(arguments: Sequence[str] | None = None) -> int:
    """Try them all; exit code 1 where one did what it must not."""
    assert __doc__ is not None
    cases = list(full_disk_cases())
    return campaign("tests.hostile.full_disks", cases, parser(__doc__).parse_args(arguments))


if __name__ == "__main__":
    raise SystemExit(main())
