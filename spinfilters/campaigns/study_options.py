"""The table ``[study]`` of a study file."""

from dataclasses import dataclass
from typing import Annotated, Final, Literal

from spinfilters.data.stated_values import NumberRange

MOST_RUNS: Final = 10_000_000
OPEN_KEYS: Final = ("seeds", "description", "time_limit_s")
"""Options that may change when a campaign is resumed: no run depends on them."""


@dataclass(frozen=True)
class StudyOptions:
    """The table ``[study]``.

    Attributes
    ----------
    name: of the study.   seeds: runs of every cell.   root_seed: of all randomness.
    initialisation: "data" as in a comparison, or "drawn": a belief drawn around the truth, for studies of filters alone.
    bound: the Cramer-Rao bound of every "run", that of the first seed of a "motion", or "none".
    time_limit_s: of one run; one that takes longer is ended, with a row that says so.
    """

    name: str
    seeds: Annotated[int, NumberRange(1, MOST_RUNS, whole=True)]
    description: str = ""
    root_seed: Annotated[int, NumberRange(0, 10**18, whole=True)] = 0
    initialisation: Literal["data", "drawn"] = "data"
    bound: Literal["run", "motion", "none"] = "run"
    time_limit_s: Annotated[float, NumberRange(1e-3, 1e6, "s")] = 600.0
