"""filterpy's sigma points without the rest of filterpy.

`import filterpy` loads all of it, and its statistics `scipy.stats`: three quarters of a second, more than a filter takes for the
bundled example. Its sigma points need neither.
"""

import sys
import threading
from importlib import import_module
from importlib.util import find_spec
from types import ModuleType
from typing import Any, Final

_PACKAGES: Final = ("filterpy", "filterpy.kalman")
_POINTS: Final = "filterpy.kalman.sigma_points"
_ONE_IMPORTS: Final = threading.Lock()


def merwe_points(n: int, alpha: float, beta: float, kappa: float) -> Any:
    """filterpy's ``MerweScaledSigmaPoints`` over ``n`` coordinates."""
    return _points_module().MerweScaledSigmaPoints(n, alpha, beta, kappa)


def _points_module() -> ModuleType:
    """The module of the points, of filterpy where it is loaded, else alone."""
    with _ONE_IMPORTS:
        places = [] if "filterpy" in sys.modules else _folders()
        if not places:
            return import_module(_POINTS)
        # Packages of these names that load nothing themselves stand in while the module is imported; then filterpy is as before.
        try:
            for name, folder in zip(_PACKAGES, places, strict=True):
                package = ModuleType(name)
                package.__path__ = [folder]
                sys.modules[name] = package
            return import_module(_POINTS)
        finally:
            for name in [each for each in sys.modules if each.split(".")[0] == "filterpy"]:
                del sys.modules[name]


def _folders() -> list[str]:
    """Folders of the packages; none where filterpy is not installed as files in one folder."""
    spec = find_spec("filterpy")
    found = [] if spec is None else list(spec.submodule_search_locations or ())
    return [found[0], f"{found[0]}/kalman"] if len(found) == 1 else []
