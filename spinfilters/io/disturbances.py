"""White disturbances of the motion: one table of their names, the blocks that they drive, and their densities.

Settings, data sets, factors of a campaign, identification, adaptation and verdict go through `DISTURBANCES`. How a disturbance
enters a step is a formula of the process: its part of the noise factor G is in `RotationSubsteps.assemble` of
`spinfilters.models.rotation_integrator`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import MappingProxyType
from typing import Final

from spinfilters.io.stated_values import NumberRange


@dataclass(frozen=True)
class Disturbance:
    """White noise that drives a block of the state.

    Attributes
    ----------
    name : str
        As in "the disturbing force"; with ``_psd`` it is the key of its density.
    block : str
        Letter of the state block that it drives; it acts on states that have this block.
    rank : int
        Order of its columns in the noise factor G, ascending; no other disturbance has the same.
    columns : int
        Of G that are its own: 6 of a white acceleration (angle and rate, or position and velocity), else the block's dimension.
    allowed : NumberRange
        Range of the density, with its unit.
    default : float
        Density where neither settings nor data set state it.
    mild : float
        Density of a calm motion, which `spinfilters.models.process.ProcessNoise` has by itself.
    axes : tuple of int
        Components of the block that it drives, all with one density.
    setting : float or str
        Default of its key in the settings' table [process]; "auto" has it identified where nobody states it.
    remark : str
        Further sentences of that key's help; "" for none.
    """

    name: str
    block: str
    rank: int
    columns: int
    allowed: NumberRange
    default: float
    mild: float
    axes: tuple[int, ...] = (0, 1, 2)
    setting: float | str = "auto"
    remark: str = ""

    @property
    def option(self) -> str:
        """Key of its density, as in dataset.toml and in the settings' table [process]."""
        return f"{self.name}_psd"

    @property
    def words(self) -> str:
        """Sentence on its density, for the help of a key."""
        return f"Density of the disturbing {self.name}, {self.allowed.unit}."


WHITE_FORCE: Final = Disturbance(
    name="force",
    block="v",
    rank=1,
    columns=6,
    allowed=NumberRange(1e-30, 1e12, "(m/s^2)^2/Hz", zero=True),
    default=1e-6,
    mild=4e-8,
    remark="0 means none, also for the torque; computations then use a density that adds 1e-9 m or rad in an interval.",
)
WHITE_TORQUE: Final = Disturbance(
    name="torque",
    block="w",
    rank=0,
    columns=6,
    allowed=NumberRange(1e-30, 1e12, "(rad/s^2)^2/Hz", zero=True),
    default=1e-6,
    mild=1e-6,
    remark=(
        '"auto" takes that of the data set, or identifies it (`spinfilters.inference.identified_noise`). For a gyro whose unknown '
        "error is correlated it follows from the rate, as found for thrown bodies."
    ),
)

DISTURBANCES: Final = (WHITE_FORCE, WHITE_TORQUE)
"""Every disturbance, in the order of tables, messages and densities. A new one is an entry here."""
DENSITIES: Final[Mapping[str, Disturbance]] = MappingProxyType({each.option: each for each in DISTURBANCES})
"""The disturbances by the keys of their densities."""
NAMES: Final = tuple(each.name for each in sorted(DISTURBANCES, key=lambda each: each.rank))
"""Names of the disturbances, in the order of their columns in G."""


def density_rows(kind: str) -> str:
    """Rows of a docstring on the densities, for a record that has each as a field.

    Parameters
    ----------
    kind : str
        Type of the fields, in words.

    Returns
    -------
    str
        Name, type and sentences of each.
    """
    rows = (f"{each.option} : {kind}\n    {each.words} {each.remark}".rstrip() for each in DISTURBANCES)
    return "\n".join(("Densities of the disturbances.\n", *rows))


@lru_cache(maxsize=256)
def noise_columns(blocks: tuple[str, ...]) -> Mapping[str, slice]:
    """Columns of the noise factor G that belong to each disturbance.

    Parameters
    ----------
    blocks : tuple of str
        Letters of the state's blocks.

    Returns
    -------
    Mapping[str, slice]
        By name, those that act on such a state, in ascending order.
    """
    places, end = {}, 0
    for each in sorted(DISTURBANCES, key=lambda each: each.rank):
        if each.block in blocks:
            places[each.name] = slice(end, end + each.columns)
            end += each.columns
    return MappingProxyType(places)


def noise_dim(blocks: tuple[str, ...]) -> int:
    """Columns of the noise factor G of a state of these blocks.

    Parameters
    ----------
    blocks : tuple of str
        Letters of the state's blocks.

    Returns
    -------
    int
        Sum over the disturbances that act on it.
    """
    return max(columns.stop for columns in noise_columns(blocks).values())
