"""A belief that a user states: mean and deviations of the first state, by words for its blocks."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.errors import InputError
from spinfilters.core.mass_distribution import from_inertia
from spinfilters.io.input_file import value_text
from spinfilters.io.measurement_log import require_unit_quaternions
from spinfilters.models.state_blocks import BLOCKS, StateBlock

WORDS: Final[dict[str, str]] = {
    "position": "t",
    "attitude": "a",
    "velocity": "v",
    "rate": "w",
    "center_of_mass": "c",
    "mass_distribution": "s",
    "drag": "d",
    "gyro_bias": "b",
    "acceleration": "f",
    "gyro_scale": "k",
    "linear_drag": "l",
}
"""State block by its word in settings: position of frame g, attitude q_ig, rate in g axes, the rest as in summary.json."""
MOMENTS: Final = "principal_moments"
"""In place of the mass distribution: moments about the axes x, y, z of g, of any scale."""
DRAWN_STD: Final[dict[str, float]] = {"t": 0.005, "a": 0.02, "v": 0.005, "w": 0.02, "c": 0.005, "s": 0.05}
"""Deviations of a belief about the truth where none are stated, in the units of the blocks."""


def block_named(key: str, name: object) -> StateBlock:
    """The state block of a word or letter. InputError: an unknown one.

    Parameters
    ----------
    key : str
        Table of the settings, for the message.
    name : object
        Word or letter of the block.

    Returns
    -------
    StateBlock
        The block.
    """
    letter = WORDS.get(str(name), str(name))
    if letter not in BLOCKS:
        raise InputError(f"initialisation.{key}.{value_text(name)[1:-1]} is unknown; use {', '.join(WORDS)}")
    return BLOCKS[letter]


def require_belief(
    mean: Mapping[str, Sequence[float]],
    std: Mapping[str, float | Sequence[float]],
    covariance: Sequence[Sequence[float]],
) -> None:
    """Require numbers that can be a belief.

    Parameters
    ----------
    mean : Mapping[str, sequence of float]
        Numbers of each block, by its word.
    std : Mapping[str, float or sequence of float]
        Standard deviation of each block, one or one for each component.
    covariance : Sequence[sequence of float]
        Rows of the covariance of all errors; empty for none.

    Raises
    ------
    InputError
        An unknown block, numbers that are not finite or too many, a covariance that is no square matrix, deviations and a
        covariance both.
    """
    for name, value in mean.items():
        _mean_of(name, value)
    for name, value in std.items():
        deviations_of(block_named("std", name), value)
    if covariance and std:
        raise InputError("initialisation.std and initialisation.covariance both state deviations; keep one")
    if covariance:
        matrix = _array("initialisation.covariance", covariance)
        if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1]:
            raise InputError(
                f"initialisation.covariance has shape {matrix.shape}; give a square matrix, its rows in the order of the state"
            )


def mean_by_block(mean: Mapping[str, Sequence[float]]) -> dict[str, Float[np.ndarray, " m"]]:
    """Points of the blocks by their letters. InputError: `require_belief`.

    Parameters
    ----------
    mean : Mapping[str, sequence of float]
        Numbers of each block, by its word.

    Returns
    -------
    dict[str, ndarray of float, shape (m,)]
        Points of the blocks, by their letters.
    """
    return dict(_mean_of(name, value) for name, value in mean.items())


def _mean_of(name: str, value: Sequence[float]) -> tuple[str, Float[np.ndarray, " m"]]:
    """Letter and point of a block."""
    numbers = np.atleast_1d(_array(f"initialisation.mean.{name}", value))
    if name == MOMENTS:
        if numbers.shape != (3,) or not (numbers > 0).all():
            raise InputError(
                f"initialisation.mean.{name} is {value_text(value)}; give three positive moments about x, y, z"
            )
        return WORDS["mass_distribution"], from_inertia(np.diag(numbers))
    block = block_named("mean", name)
    if numbers.shape != (block.mean_size,):
        raise InputError(
            f"initialisation.mean.{name} is {value_text(value)}; give {block.mean_size} numbers, {block.unit}"
        )
    if block.mean_size != block.dimension:  # an attitude
        try:
            require_unit_quaternions(f"initialisation.mean.{name}", numbers[np.newaxis])
        except InputError as error:
            raise InputError(f"initialisation.mean.{name}: {error}") from None
        numbers = numbers / np.linalg.norm(numbers)
    return block.name, numbers


def deviations_of(block: StateBlock, value: float | Sequence[float]) -> Float[np.ndarray, " n"]:
    """Standard deviations of a block's error: one for all components, or one for each.

    Parameters
    ----------
    block : StateBlock
        The block.
    value : float or sequence of float
        One deviation, or one for each component.

    Returns
    -------
    ndarray of float, shape (n,)
        Standard deviation of each component of the error.

    Raises
    ------
    InputError
        Another number of them, or one that is not positive.
    """
    word = next(word for word, letter in WORDS.items() if letter == block.name)
    numbers = _array(f"initialisation.std.{word}", value)
    if numbers.shape not in ((), (block.dimension,)) or not (numbers > 0).all():
        raise InputError(
            f"initialisation.std.{word} is {value_text(value)}; give a positive number, or {block.dimension} of them, {block.unit}"
        )
    return np.broadcast_to(numbers, block.dimension)


def _array(name: str, value: Any) -> np.ndarray:
    """Finite numbers of a setting. InputError: other values."""
    try:
        if isinstance(value, str | bytes | bool):
            raise TypeError
        numbers = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{name} is {value_text(value)}; give numbers") from None
    if not np.isfinite(numbers).all():
        raise InputError(f"{name} is {value_text(value)}; give finite numbers")
    return numbers
