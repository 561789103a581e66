"""Entry point of the command ``spinfilters``: Ctrl-C is answered before anything else is loaded."""

import gc
import sys

from spinfilters.cli.interrupts import INTERRUPTED, noted_interrupts, require_uninterrupted


def main() -> int:
    """Load the command and run it; exit code 2 behind one line where Ctrl-C came meanwhile."""
    with noted_interrupts():
        try:
            from spinfilters.cli.main import main as run_command

            require_uninterrupted()  # an import may lose it
        except KeyboardInterrupt:
            print(f"spinfilters: {INTERRUPTED}", file=sys.stderr)
            return 2
        code = run_command()
        gc.freeze()  # the interpreter would look through all that is left, several times, only to end
        return code
