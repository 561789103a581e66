"""The invariant extended Kalman filter: the MEKF with the error coordinates of a group of rigid motions."""

from spinfilters.filters.compiled_steps import Update
from spinfilters.filters.ekf import FirstOrderFilter
from spinfilters.filters.error_coordinates import ErrorCoordinates, InvariantOptions
from spinfilters.filters.estimator import ProcessModel
from spinfilters.filters.filter import PredictedMeasurement
from spinfilters.filters.noise_levels import AdaptationOptions
from spinfilters.filters.outlier_rejection import RobustOptions
from spinfilters.filters.square_root import square_root_update


class InvariantEkf(FirstOrderFilter):
    """First-order filter whose error coordinates couple attitude, position and velocity, by default as SE_2(3).

    Predictions are those of the MEKF, because a covariance about the mean is the same in all coordinates to first order. An update
    moves the mean along the group and the covariance by the derivative of that move. It is not iterated.

    Parameters
    ----------
    process : ProcessModel
        See `MultiplicativeFilter`.
    robust, adaptation
        See `MultiplicativeFilter`.
    options : InvariantOptions or None
        Which error coordinates.
    """

    name = "invariant"

    def __init__(
        self,
        process: ProcessModel,
        robust: RobustOptions | None = None,
        adaptation: AdaptationOptions | None = None,
        options: InvariantOptions | None = None,
    ) -> None:
        super().__init__(process, robust, adaptation)
        self._coordinates = ErrorCoordinates(self.layout, (options or InvariantOptions()).coordinates)

    def correct_linearly(self, predicted: PredictedMeasurement) -> Update:
        """The correction by values that are linear in the error, folded into the mean along the group."""
        correction = square_root_update(predicted.predicted(self.factor))
        mean, factor = self._coordinates.fold(self.mean, correction.error, correction.factor)
        return Update(mean, correction, factor)
