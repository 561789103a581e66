"""What a command loads before it does anything: no more than it needs."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("started", "unneeded"),
    [
        ("import spinfilters.cli.entry_point", ("argparse", "logging", "inspect", "dataclasses", "difflib")),
        ("import spinfilters.cli.main", ("numpy", "casadi", "rich", "pydantic", "matplotlib")),
        (
            "from spinfilters.cli.main import main; main(['compare', 'no-such-recording.csv'])",
            (
                "pydantic",
                "matplotlib",
                "rich",
                "yaml",
                "scipy.special",
                "scipy.spatial",
                "scipy.optimize",
                "scipy.sparse",
                "scipy.stats",
                "spinfilters.run.estimation",
                "spinfilters.simulation.scenario",
                "spinfilters.run.free_flight",
            ),
        ),
        (
            "import spinfilters.smoother.sliding_smoother",
            ("yaml", "scipy.special", "scipy.sparse", "scipy.optimize"),
        ),
        ("import spinfilters.settings.run_settings", ("filterpy", "scipy.stats")),
        (
            "from spinfilters.filters.filterpy_points import merwe_points; merwe_points(2, 1.0, 2.0, 0.0)",
            ("filterpy", "scipy.stats", "scipy.optimize"),
        ),
        (
            "from numpy import ones; from spinfilters.verdict.model_errors.noise_components import weighted_chi_square_tail; "
            "weighted_chi_square_tail(ones(2), 3.0, 5.0)",
            ("scipy.stats", "scipy.optimize"),
        ),
    ],
)
def test_nothing_is_loaded_before_it_is_needed(started: str, unneeded: tuple[str, ...]) -> None:
    """In a process of its own: here other tests have loaded everything."""
    look = f"import sys; {started}; print([name for name in {unneeded} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
