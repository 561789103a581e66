"""An alternative to the models of the estimators.

Score tests ask it for its right-hand sides.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from jaxtyping import Float

from spinfilters.estimators.model_errors.columns import Columns
from spinfilters.estimators.model_errors.smoothed_motion import SmoothedMotion
from spinfilters.state.block import StateBlock


class Alternative(ABC):
    """An error that the models may have. A subclass states its attributes and writes `columns`.

    Attributes
    ----------
    name: of the error.   phrase: in a sentence, with its article.   unit: of its size.   cure: what to do about it.
    moving_cure: the same where poses of a moving camera are given; empty where that makes no difference.
    trials: places in a recording among which it was sought where it is likeliest.
    by_epoch: whether it is drawn anew at every epoch; if not, it is the same in all.
    plausible: standard deviation of what its size is before anything is measured; infinite where nothing is known.
    only_positive: whether its one size is of one sign: what brakes does not drive.
    is_of_poses: whether it is one of the poses given of a moving camera.
    block: of a state that holds it, None where none does.   held_by: settings that put it there, by table and key.
    """

    name: str
    phrase: str
    unit: str
    cure: str
    moving_cure: str = ""
    trials: int = 1
    by_epoch: ClassVar[bool] = False
    plausible: ClassVar[float] = float("inf")
    only_positive: ClassVar[bool] = False
    is_of_poses: ClassVar[bool] = False
    block: ClassVar[StateBlock | None] = None
    held_by: ClassVar[Mapping[str, Mapping[str, bool | float]]] = MappingProxyType({})

    def cure_before(self, has_inspector: bool) -> str:
        """What to do about it, where poses of a moving camera are given or not."""
        return self.moving_cure if has_inspector and self.moving_cure else self.cure

    @abstractmethod
    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Whitened right-hand sides per unit of it, one for each component.

        None where a data set cannot have it.
        """

    def is_possible(self, size: Float[np.ndarray, " m"], motion: SmoothedMotion) -> bool:
        """Whether a recording can have an error of this size at all."""
        return True

    def is_held(self, motion: SmoothedMotion) -> bool:
        """Whether the state has it already."""
        return self.block is not None and motion.rows.problem.layout.has(self.block)
