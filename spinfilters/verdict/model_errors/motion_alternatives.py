"""Errors of the motion's model: forces and torques, contact, moving parts, and jumps amid a recording."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np
from jaxtyping import Float

from spinfilters.inference.noise_model import StepsAfter, steps_after
from spinfilters.models.state_blocks import (
    ACCELERATION,
    ATTITUDE,
    DRAG,
    POSITION,
    RATE,
    ROTOR,
    TORQUE,
    VELOCITY,
    StateBlock,
)
from spinfilters.smoother.linear_system import Marginals
from spinfilters.verdict.model_errors.linear_rows import Columns
from spinfilters.verdict.model_errors.score_tests import Alternative
from spinfilters.verdict.model_errors.sensor_alternatives import SHEARS as TRACELESS
from spinfilters.verdict.model_errors.smoothed_motion import SmoothedMotion


class ConstantAcceleration(Alternative):
    """v' gains a constant, i axes."""

    name, phrase, unit = "acceleration", "a constant acceleration", "m/s^2"
    cure = "set process.gravity = true"
    block = ACCELERATION
    held_by: ClassVar = {"process": {"gravity": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Three columns of the acceleration of the centre of mass, i axes."""
        if not motion.translates:
            return None
        return motion.disturbed(linear=np.tile(np.eye(3), (len(motion.time), 1, 1)))


class AirResistance(Alternative):
    """v' loses k |v| v, i axes."""

    name, phrase, unit = "air-resistance", "air that brakes the path", "1/m"
    plausible = 1.0
    only_positive = True
    cure = "take a slower or shorter throw, or state a larger process.force_psd"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: deceleration along the velocity by its square."""
        if not motion.translates:
            return None
        v = motion.block(VELOCITY.name)
        return motion.disturbed(linear=-(np.linalg.norm(v, axis=1, keepdims=True) * v)[:, :, None])


SHARE, FEWEST = 0.05, 2
"""Of the epochs within which a contact ends or begins, and how many they are at least."""
MOST_SHARE = 0.25
"""Of a recording: a touch for longer is a constant force or torque."""


@dataclass(frozen=True)
class _Contact(Alternative):
    """A constant force and torque while it lasts."""

    def _touching(self, motion: SmoothedMotion, at_end: bool) -> Columns | None:
        count = max(FEWEST, round(SHARE * len(motion.time)))
        if count > MOST_SHARE * len(motion.time):
            return None
        touched = np.zeros(len(motion.time))
        touched[-count:] += at_end
        touched[:count] += not at_end
        each = touched[:, None, None] * np.eye(3)
        none = np.zeros_like(each)
        if not motion.translates:
            return motion.disturbed(angular=each)
        return motion.disturbed(
            angular=np.concatenate([each, none], axis=2), linear=np.concatenate([none, each], axis=2)
        )


class ContactAtBegin(_Contact):
    """In the first epochs."""

    name, phrase, unit = "contact-at-begin", "contact in the first epochs", "rad/s^2 and m/s^2"
    cure = "begin the recording later (--segment)"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of accelerations in the first epochs."""
        return self._touching(motion, at_end=False)


class ContactAtEnd(_Contact):
    """In the last epochs."""

    name, phrase, unit = "contact-at-end", "contact in the last epochs", "rad/s^2 and m/s^2"
    cure = "end the recording earlier (--segment)"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of accelerations in the last epochs."""
        return self._touching(motion, at_end=True)


class Drag(Alternative):
    """w' loses d |w| w."""

    name, phrase, unit = "drag", "drag of the rotation", "1/rad"
    plausible = 0.05
    only_positive = True
    cure = 'set process.drag = "auto"'
    block = DRAG
    held_by: ClassVar = {"process": {"drag": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: angular deceleration by the square of the rate."""
        speed = np.linalg.norm(motion.rates, axis=1, keepdims=True)
        return motion.disturbed(angular=-(speed * motion.rates)[:, :, None])


class Hinge(Alternative):
    """Linear change of the inertia over time, as of a hinge.

    J gains J^1/2 B J^1/2 s, B symmetric and traceless, s from -1 to 1: with D for it J w' loses (D s)' w, and turns with D s w.
    About the smoothed motion J dw' = (D s w) x w - D s w' - D s' w. What is constant is of the body's own
    shape, and a B that is a multiple of the identity brakes the rotation as drag does.
    """

    name, phrase, unit = "hinge", "parts that move inside (a hinge, an elbow)", "of the moments"
    plausible = 0.3
    cure = "lock the joint: a body that is not rigid has no constant moments"

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of the inertia's traceless linear changes."""
        J, w, change = motion.inertia, motion.rates, motion.rate_change
        half = (motion.time[-1] - motion.time[0]) / 2
        share = ((motion.time - motion.time[0]) / half - 1)[:, None]
        values, axes = np.linalg.eigh(J)
        root = axes * np.sqrt(values) @ axes.T
        gained = [share * (np.cross(w @ D, w) - change @ D) - w @ D / half for D in root @ TRACELESS @ root]
        return motion.disturbed(angular=np.linalg.solve(J, np.stack(gained, axis=2)))


class EnergyLoss(Alternative):
    """Energy dissipation: the kinetic energy falls, the angular momentum stays.

    J w' loses k |h| (w less its part along h).
    """

    name, phrase, unit = "energy-loss", "a loss of energy within the body", "1/rad"
    plausible = 0.3
    only_positive = True
    cure = (
        "something sloshes or flexes inside: take a shorter recording, or state a larger process.torque_psd"
    )

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """One column: torque against the rate across the angular momentum."""
        momentum = motion.rates @ motion.inertia
        size = np.linalg.norm(momentum, axis=1, keepdims=True)
        along = momentum / np.maximum(size, np.finfo(float).tiny)
        across = motion.rates - along * np.einsum("ki,ki->k", along, motion.rates)[:, None]
        lost = np.linalg.solve(motion.inertia, (size * across).T).T
        return motion.disturbed(angular=-lost[:, :, None])


class Rotor(Alternative):
    """Constant angular momentum h of a flywheel inside.

    J w' gains h x w; h in units of J times rad/s. What of it the moments take up leaves no residual: h along a spin about a
    principal axis is such a part, for there J w + h is the J' w of another body.
    """

    name, phrase, unit = "rotor", "a flywheel turning inside", "rad/s"
    plausible = 1.0
    cure = "set process.rotor = true, or stop the flywheel while recording"
    block = ROTOR
    held_by: ClassVar = {"process": {"rotor": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Three columns of the flywheel's angular momentum, g axes."""
        cross = np.cross(np.eye(3)[:, None], motion.rates[None])  # h along each axis, epoch
        gained = np.linalg.solve(motion.inertia, np.moveaxis(cross, 0, 2))
        return motion.disturbed(angular=gained)


class ConstantTorque(Alternative):
    """w' gains a constant, g axes."""

    name, phrase, unit = "torque", "a constant body torque", "rad/s^2"
    cure = "set process.body_torque = true"
    block = TORQUE
    held_by: ClassVar = {"process": {"body_torque": True}}

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Three columns of the angular acceleration, g axes."""
        return motion.disturbed(angular=np.tile(np.eye(3), (len(motion.time), 1, 1)))


Kicks = Callable[[SmoothedMotion], Float[np.ndarray, "k n m"]]
"""Changes of the state's error at every epoch per unit of m sizes, components in the order of the layout."""
LEAST_TOLD: Final = 1e-9
"""Share of a kick's information that states must leave; with less it is rounding."""
FEWEST_STEPS: Final = 4
"""Before and behind a jump: nearer to the ends it is contact there."""
LARGEST_FALL: Final = float(-2 * np.log(1 - np.sqrt(0.99)))
"""Of the statistic from the likeliest step to one that contains the jump all the same, with a probability of 0.99."""


@dataclass(frozen=True)
class Jump(Alternative):
    """A kick of the state at the end of one step.

    Attributes
    ----------
    kicks : Kicks
        Of every epoch.
    step : int
        Of them the one that is kicked.
    """

    kicks: Kicks
    step: int
    name: str
    phrase: str
    unit: str
    cure: str
    trials: int
    moving_cure: str = ""

    def columns(self, motion: SmoothedMotion) -> Columns | None:
        """Columns of the kick as all later measurements see it."""
        return motion.kicked(self.kicks(motion)[self.step + 1], self.step)


@dataclass(frozen=True)
class _Kind:
    """Kind of jump with its words.

    The time of the jump follows the phrase; the cure may name the interval from ``begin`` to ``end`` that contains it, s.
    """

    name: str
    phrase: str
    unit: str
    cure: str
    kicks: Kicks
    moving_cure: str = ""


def jumps(motion: SmoothedMotion) -> Iterator[Jump]:
    """Of every kind the jump at its likeliest step; none in recordings too short for one."""
    count = len(motion.time) - 1
    if count <= 2 * FEWEST_STEPS:
        return
    after = _steps_after(motion)
    for kind in KINDS:
        among = step_statistics(motion, kind.kicks, after)[FEWEST_STEPS:-FEWEST_STEPS]
        if among.max(initial=0.0) > 0:
            step = FEWEST_STEPS + int(among.argmax())
            begin, end = interval_of_jump(motion.time, among)
            phrase = (
                f"{kind.phrase} at t = {motion.time[step + 1]:.4g} s, between {begin:.6g} and {end:.6g} s"
            )
            cure, moving_cure = (
                each.format(begin=f"{begin:.6g}", end=f"{end:.6g}") for each in (kind.cure, kind.moving_cure)
            )
            yield Jump(kind.kicks, step, kind.name, phrase, kind.unit, cure, len(among), moving_cure)


def interval_of_jump(time: Float[np.ndarray, " k"], among: Float[np.ndarray, " j"]) -> tuple[float, float]:
    """Time from the beginning of the first step that may contain the jump to the end of the one behind the last, s.

    The kick of a step is at its end: one early in the next step is as near to it.

    Parameters
    ----------
    among : (j,) float array
        Statistics of the steps, without `FEWEST_STEPS` at each end.
    """
    possible = FEWEST_STEPS + np.flatnonzero(among >= among.max() - LARGEST_FALL)
    return float(time[possible[0]]), float(time[possible[-1] + 2])


def _steps_after(motion: SmoothedMotion) -> StepsAfter:
    rows = motion.rows
    return steps_after(rows.problem, rows.here, Marginals(rows.solution, rows.normal.eliminated))


def step_statistics(
    motion: SmoothedMotion, kicks: Kicks, after: StepsAfter | None = None
) -> Float[np.ndarray, " j"]:
    """Score statistic of a kick in every step.

    Parameters
    ----------
    after : StepsAfter or None
        What the solution leaves of the steps, where it is known already.
    """
    after = after or _steps_after(motion)
    H = motion.kicks_of_steps(kicks(motion))
    # per step: information F = H'H - H'(J P J')H and score u = H'r of its kicks, in units of their own size
    across = np.swapaxes(H, 1, 2)
    whole, spread = across @ H, across @ after.spread
    scale = np.sqrt(np.einsum("kmm->km", whole))
    unit = np.where(scale > 0, 1 / np.where(scale > 0, scale, 1.0), 0.0)
    F = (whole - spread @ np.swapaxes(spread, 1, 2)) * unit[:, :, None] * unit[:, None, :]
    u = np.einsum("kdm,kd->km", H, after.rest) * unit
    if not (np.isfinite(F).all() and np.isfinite(u).all()):
        return np.zeros(len(H))
    # u' F^+ u over the directions that the measurements show
    values, vectors = np.linalg.eigh(F)
    along = np.einsum("kmv,km->kv", vectors, u)
    told = values > LEAST_TOLD
    return np.where(told, along**2 / np.where(told, values, 1.0), 0.0).sum(axis=1)


def _of_blocks(*blocks: StateBlock) -> Kicks:
    """Every component of those of some blocks that a state has."""

    def kicks(motion: SmoothedMotion) -> Float[np.ndarray, "k n m"]:
        """The same at every epoch."""
        layout = motion.rows.problem.layout
        every = np.eye(layout.error_dim)
        chosen = np.concatenate([every[:, layout.slice(b.name)] for b in blocks if layout.has(b)], axis=1)
        return np.broadcast_to(chosen, (len(motion.time), *chosen.shape))

    return kicks


KINDS: Final = (
    _Kind(
        "contact-amid",
        "contact",
        "rad/s and m/s",
        "use the recording before {begin} s or after {end} s (--segment)",
        _of_blocks(RATE, VELOCITY),
    ),
    _Kind(
        "frame-jump",
        "a jump of the camera, or of the frame that is tracked,",
        "rad and m",
        "use the recording before {begin} s or after {end} s (--segment), or give the camera's motion (inspector.tum)",
        _of_blocks(ATTITUDE, POSITION),
        "use the recording before {begin} s or after {end} s (--segment), or give poses without a jump (inspector.tum)",
    ),
    _Kind(
        "clock-jump",
        "a jump of the clock, as where samples are lost,",
        "s",
        "give every sample its own time stamp",
        lambda motion: motion.change[:, :, None],
    ),
)
