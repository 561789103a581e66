"""A study whose caller can mend what is wrong ends in one line."""

import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from spinfilters.core.errors import SpinfiltersError
from spinfilters.io.input_file import printable

EXIT_BAD_INPUT = 2
Row = dict[str, Any]
INTERRUPTED = "interrupted; run the command again, or with --resume where it has that"


def run_study(main: Callable[[], None]) -> None:
    """Run the main function of a study or benchmark.

    SystemExit: 2, behind one line on standard error, for bad input, a file that the system refuses, or Ctrl-C.
    Every other error is a defect and shows its trace.
    """
    try:
        main()
    except SpinfiltersError as error:
        complaint = str(error)
    except KeyboardInterrupt:
        complaint = INTERRUPTED
    except OSError as error:
        if error.filename is None:
            raise
        complaint = f"{error.filename}: {error.strerror}; give another name, or free it, then run again"
    else:
        return
    print(f"experiments: {printable(' '.join(complaint.split()))}", file=sys.stderr)
    raise SystemExit(EXIT_BAD_INPUT)


def rows_of_seeds(
    make: Callable[[int], Iterable[Row]], seeds: Iterable[int], output: Path | None = None
) -> list[Row]:
    """Rows of a study, seed after seed, each written as a line of JSON behind a file as soon as it is there."""
    rows: list[Row] = []
    for seed in seeds:
        new = list(make(seed))
        if output is not None:
            with output.open("a", encoding="utf-8") as file:
                file.writelines(json.dumps(row) + "\n" for row in new)
        rows += new
    return rows
