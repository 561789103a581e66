"""What ``import spinfilters`` offers, how lightly, and whether the README's first lines work as they stand."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import spinfilters

ROOT = Path(__file__).parents[2]


def test_importing_it_loads_no_numerics() -> None:
    """In a process of its own: here other tests have loaded everything."""
    look = "import sys, spinfilters; print([name for name in ('numpy', 'casadi', 'pydantic') if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"


@pytest.mark.parametrize("name", spinfilters.__all__)
def test_every_public_name_is_there_with_a_docstring(name: str) -> None:
    found = getattr(spinfilters, name)
    assert found.__doc__
    assert found is getattr(spinfilters, name)
    assert name in dir(spinfilters)


def test_a_name_that_is_not_public_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="'spinfilters' has no attribute 'magic'"):
        _ = spinfilters.magic  # pyright: ignore[reportAttributeAccessIssue]


def first_python_of_readme() -> str:
    """The first block of Python in the README."""
    return re.findall(r"^```python\n(.*?)^```", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)[0]


def test_five_lines_of_the_readme_lead_from_ones_own_csv_to_a_picture(tmp_path: Path, own_csv: str) -> None:
    code = first_python_of_readme()
    assert len([line for line in code.splitlines() if line.strip()]) <= 5
    (name,) = re.findall(r'compare\("(.*?\.csv)"\)', code)
    (tmp_path / name).write_text(own_csv, encoding="utf-8")
    found = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert "J smallest / largest" in found.stdout
    (picture,) = tmp_path.glob("*.png")
    assert picture.read_bytes().startswith(b"\x89PNG")
