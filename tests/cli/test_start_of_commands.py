"""What a command loads before it does anything: no more than it needs."""

import subprocess
import sys


def test_comparing_loads_nothing_that_draws() -> None:
    """In a process of its own: here other tests have drawn."""
    look = "import sys, spinfilters.cli.compare; print('matplotlib' in sys.modules)"
    found = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "False"
