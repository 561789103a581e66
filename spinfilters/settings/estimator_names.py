"""Names of the estimators that settings choose from.

Settings stand below the estimators themselves, whose table is `spinfilters.pipeline.estimator_table`.
"""

from typing import Final

from spinfilters.plugins import installed_plugins

DEFAULT_ESTIMATORS: Final = ("mekf", "ukf", "smoother")
"""Estimators of a comparison where nobody names any."""
ESTIMATORS: Final = (
    *("mekf", "ukf", "smoother"),
    *("filterpy-ekf", "filterpy-ukf"),
    *("embedded", "embedded-double"),
    "smoother-latest",
)
"""Estimators of this package, in the order of the table."""


class NamedEstimator:
    """An estimator as far as settings know it.

    Attributes
    ----------
    name: as in ``--estimators``; also its folder in a run.
    order: of the table and of messages.   is_default: whether a comparison has it where nobody names estimators.
    """

    name: str
    order: int = 100
    is_default: bool = False


def estimator_names() -> tuple[str, ...]:
    """Names of all estimators, in the order of the table. InputError: a plug-in that cannot be loaded."""
    others = installed_plugins("spinfilters.estimators", NamedEstimator)
    every = [*enumerate(ESTIMATORS), *((each.order, each.name) for each in others)]
    return tuple(dict.fromkeys(name for _, name in sorted(every, key=lambda each: each[0])))


def names_in(text: str) -> tuple[str, ...]:
    """Names that a text lists with commas."""
    return tuple(name.strip() for name in text.split(",") if name.strip())
