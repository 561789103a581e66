"""Worker process: numbers of runs in, rows out, as lines of JSON.

    python -m spinfilters.campaigns.worker

Its own alarm ends it when a run takes longer than the study allows, wherever the run hangs; when its input ends, so does it.
"""

import json
import os
import signal
import sys
from contextlib import suppress
from typing import BinaryIO


def main() -> None:
    """Serve until the input ends."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for who asked
    signal.signal(signal.SIGALRM, signal.SIG_DFL)  # ends the process wherever it is
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # what libraries print is no answer
    with suppress(OSError), open("/proc/self/oom_score_adj", "w") as score:
        score.write("1000")  # short of memory, the system is to end this process and not who waits for it
    with suppress(BrokenPipeError):
        serve(sys.stdin.buffer, answers)


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Answer each number with the row of its run."""
    first = requests.readline()
    if not first:
        return
    import warnings

    warnings.filterwarnings(
        "ignore", category=RuntimeWarning
    )  # of numbers that are not finite: a status tells of them
    from spinfilters.campaigns.runner import Runner
    from spinfilters.campaigns.study import study_from

    study = study_from(json.loads(first), "study")
    runner, limit = Runner(study), study.options.time_limit_s
    answers.write(b"ready\n")
    for request in iter(requests.readline, b""):
        signal.setitimer(signal.ITIMER_REAL, limit)
        row = runner.row(int(request))
        signal.setitimer(signal.ITIMER_REAL, 0)
        answers.write(json.dumps(row).encode() + b"\n")


if __name__ == "__main__":
    main()
