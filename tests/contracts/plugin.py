"""A distribution on the path whose one module brings an entry point, as a plug-in from outside does."""

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from spinfilters.core.plugins import installed_plugins


def program_of(page: Path) -> str:
    """The first program of a how-to page."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(), re.MULTILINE | re.DOTALL)[0]


@contextmanager
def installed_plugin(group: str, entry_point: str, program: str, folder: Path) -> Iterator[Path]:
    """The file of the plug-in's module, while it is installed in a folder.

    Parameters
    ----------
    group: name of the entry points.
    entry_point: as in entry_points.txt, ``name = module:OBJECT``.
    """
    name, module = re.fullmatch(r"(\S+) = (\w+):\w+", entry_point).groups()  # pyright: ignore[reportOptionalMemberAccess]
    information = folder / "site" / f"{module}-1.0.dist-info"
    information.mkdir(parents=True)
    (information / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (information / "entry_points.txt").write_text(f"[{group}]\n{entry_point}\n")
    file = information.parent / f"{module}.py"
    file.write_text(program)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(information.parent))
        installed_plugins.cache_clear()
        yield file
    sys.modules.pop(module, None)
    installed_plugins.cache_clear()
