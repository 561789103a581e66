"""``python -m spinfilters``: the command, also where its script is not on the path."""

import sys

from spinfilters.cli.entry_point import main

if __name__ == "__main__":
    sys.exit(main())
