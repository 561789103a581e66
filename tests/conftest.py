"""What all tests share: checked shapes, figures without a screen, and the recordings of `../shared/data`."""

from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import pytest
from shape_checks import check_shapes_of

check_shapes_of("spinfilters")
check_shapes_of("observability")
mpl.use("Agg")

SHARED_DATA = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="session")
def shared_data() -> Callable[[str], Path]:
    """Path of a recording, ``shared_data("disam115")``; the test is skipped where it is absent."""

    def find(name: str) -> Path:
        path = SHARED_DATA / name
        if not path.exists():
            pytest.skip(f"no recording at {path}")
        return path

    return find
