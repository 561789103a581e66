"""Camera pose in frame i as parameters of a measurement.

None where the camera rests, seven where it moves.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from spinfilters.attitude.expressions import Expression, conjugate, rotate


class CameraPoseModel(ABC):
    """T_ic, written with ``parameter_dim`` parameters of a measurement."""

    parameter_dim: int

    @abstractmethod
    def in_camera(self, point: Expression, parameters: Expression) -> Expression:
        """p_c = R_ic' (p_i - t_ic)."""

    @abstractmethod
    def in_inertial(self, point: Expression, parameters: Expression) -> Expression:
        """p_i = R_ic p_c + t_ic."""


@dataclass(frozen=True)
class RestingCamera(CameraPoseModel):
    """Camera at rest that defines frame i, without parameters."""

    parameter_dim = 0

    def in_camera(self, point: Expression, parameters: Expression) -> Expression:
        """p_c = p_i."""
        return point

    def in_inertial(self, point: Expression, parameters: Expression) -> Expression:
        """p_i = p_c."""
        return point


@dataclass(frozen=True)
class MovingCamera(CameraPoseModel):
    """Parameters (t_ic 3 m, q_ic 4)."""

    parameter_dim = 7

    def in_camera(self, point: Expression, parameters: Expression) -> Expression:
        """p_c = R_ic' (p_i - t_ic)."""
        return rotate(conjugate(parameters[3:]), point - parameters[:3])

    def in_inertial(self, point: Expression, parameters: Expression) -> Expression:
        """p_i = R_ic p_c + t_ic."""
        return rotate(parameters[3:], point) + parameters[:3]


RESTING, MOVING = RestingCamera(), MovingCamera()


def camera_pose_model(poses: Float[np.ndarray, "k 7"] | None) -> CameraPoseModel:
    """Camera pose model of measurements at such poses."""
    return RESTING if poses is None else MOVING


def with_camera_poses(
    parameters: Float[np.ndarray, "k p"], poses: Float[np.ndarray, "k 7"] | None
) -> Float[np.ndarray, "k q"]:
    """Parameters of measurements with the camera's poses (t_ic m, q_ic) behind them; none where it rests."""
    return parameters if poses is None else np.concatenate([parameters, poses], axis=1)
