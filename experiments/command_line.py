"""A study whose caller can mend what is wrong ends in one line."""

import sys
from collections.abc import Callable

from spinfilters.core.errors import SpinfiltersError
from spinfilters.io.input_file import printable

EXIT_BAD_INPUT = 2
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
