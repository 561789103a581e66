"""State block.

One named part of a state. It holds all that layouts, models, estimators and tables ask about it.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf

from spinfilters.attitude.expressions import Expression

PointAndError = Callable[[Expression, Expression], Expression]
"""From a point and an error, or from two points."""


def add(point: Expression, error: Expression) -> Expression:
    """The point at an additive error."""
    return point + error


def subtract(here: Expression, there: Expression) -> Expression:
    """The additive error that takes ``here`` to ``there``."""
    return there - here


@dataclass(frozen=True)
class ErrorChart:
    """Points and errors of a block, as CasADi expressions; by default both are vectors that add.

    Attributes
    ----------
    retract: (point, error) to the point at that error.
    local: (here, there) to the error that takes one to the other.
    near_local: ``local`` to first order at here = there, for derivatives there: a shorter expression.
    reset_jacobian: derivative of the error about retract(x, d) by the error about x, at d; None where it is the identity.
    normalised: a point without rounding off its manifold; None where every number is a point.
    """

    retract: PointAndError = add
    local: PointAndError = subtract
    near_local: PointAndError = subtract
    reset_jacobian: Callable[[Expression], Expression] | None = None
    normalised: Callable[[Expression], Expression] | None = None


@dataclass(frozen=True)
class RotationParameters:
    """Numbers by which a constant block enters the equation of the body rate.

    Attributes
    ----------
    count: how many.   of: them from a point of the block.
    """

    count: int
    of: Callable[[Expression], Expression]


@dataclass(frozen=True)
class ReportedConstant:
    """A block as one of the results of a run.

    Attributes
    ----------
    value_key, std_key: of its value and standard deviation in `summary.json`.
    value_format, std_format: of a number in the table.
    """

    value_key: str
    std_key: str
    value_format: str = ".3g"
    std_format: str = ".2g"


@dataclass(frozen=True)
class StateBlock:
    """A part of a state.

    Attributes
    ----------
    name: its letter in layouts and formulas.   rank: its place among the blocks of a layout, ascending.
    dimension: of its error.   unit: of its error.
    label: in tables and figures.   phrase: in a sentence, with its article.
    constant: whether it is the same at every time; if not, the process model moves it.
    translational: whether it means anything only where the state has a position.
    prior_std: of the prior of the first state, in `unit`.   prior_option: of the initialisation, which has it instead; "" for none.
    prior_at_origin: whether that prior lies at the origin, not at what the first measurements say.
    symbol: of its point among the expressions of a state, its name by default.
    chart: of its points and errors.   origin: its point of reference; zeros by default.
    largest_step: of a component in one iteration, beyond which a linear model of it says nothing.
    rotation: how it enters the equation of the body rate, None where it does not.
    after_gauge_move: the point once frame g has been moved by the rotation R and then rho (m), both in g axes, from
        (point, R, rho); None where it does not depend on g.
    truth_field: of a `Truth`, which is this block's point; "" where the truth does not hold it as such.
    reported: how it is shown as a result of its own, None where it is not.
    """

    name: str
    rank: int
    dimension: int
    unit: str
    label: str
    phrase: str
    constant: bool
    translational: bool = False
    prior_std: float = 1.0
    prior_option: str = ""
    prior_at_origin: bool = True
    symbol: str = ""
    chart: ErrorChart = field(default_factory=ErrorChart)
    origin: tuple[float, ...] = ()
    largest_step: float = inf
    rotation: RotationParameters | None = None
    after_gauge_move: Callable[[Expression, Expression, Expression], Expression] | None = None
    truth_field: str = ""
    reported: ReportedConstant | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "symbol", self.symbol or self.name)
        object.__setattr__(self, "origin", self.origin or (0.0,) * self.dimension)

    @property
    def mean_size(self) -> int:
        """Numbers of a point."""
        return len(self.origin)


def vector_after_gauge_move(vector: Expression, R: Expression, rho: Expression) -> Expression:
    """Components of a vector in axes g once g has been rotated."""
    return R @ vector
