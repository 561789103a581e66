"""Simulated feature tracks: which landmarks of a surface are visible, detected and recognised again."""

import ctypes
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from itertools import pairwise
from typing import Any, Final, NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float, Int

from spinfilters.core.c_library import FLAGS, NATIVE, Signature, load_text, with_signatures
from spinfilters.core.cameras import Monocular
from spinfilters.core.compiled import address
from spinfilters.core.errors import InputError
from spinfilters.io.camera import PinholeCamera, Rig, StereoRig
from spinfilters.models.measurement import MeasurementModel
from spinfilters.models.state_layout import StateLayout

NEAREST_M: Final = 0.05
"""Depth in m below which nothing is in focus."""
_FLAGS: Final = (*FLAGS, "-O3", NATIVE, "-fno-math-errno", "-fno-trapping-math")
_SIGNATURES: Final = {
    "facing": Signature("iippppppp" + "dp", None),
    "recognised": Signature("iippppppp", None),
    "detections": Signature("ppiip" + "dippp", None),
}


class Surface(NamedTuple):
    """Landmarks (k, 3) m and their outward unit normals (k, 3), frame g."""

    points: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]


def facing(
    cosine: float,
    surface: Surface,
    rotations: Float[np.ndarray, "n 3 3"],
    origins: Float[np.ndarray, "n 3"],
) -> Bool[np.ndarray, "n k"]:
    """Mask of landmarks beyond `NEAREST_M` that face the camera.

    A landmark faces the camera if the cosine between its normal and the line to the camera exceeds the given one.

    Parameters
    ----------
    rotations, origins
        Of g in the camera's frame at every epoch, m.
    """
    camera = -np.einsum("nji,nj->ni", rotations, origins)  # its place in g
    least, library = NEAREST_M - origins[:, 2], _library()
    if library is None:
        return _facing_in_numpy(cosine, surface, camera, rotations[:, 2], least)
    points, normals = (np.ascontiguousarray(each.T) for each in surface)
    heights, squares = np.einsum("ik,ik->k", normals, points), np.square(points).sum(axis=0)
    found = np.empty((len(origins), len(heights)), dtype=bool)
    given = (points, normals, heights, squares, *map(np.ascontiguousarray, (camera, rotations[:, 2], least)))
    library.facing(*found.shape, *map(address, given), cosine, address(found))
    return found


def _facing_in_numpy(
    cosine: float,
    surface: Surface,
    camera: Float[np.ndarray, "n 3"],
    axes: Float[np.ndarray, "n 3"],
    least: Float[np.ndarray, " n"],
) -> Bool[np.ndarray, "n k"]:
    """Facing landmarks in NumPy.

    The same from places and optical axes of the camera in g and the least coordinate along the latter.
    """
    points, normals = surface
    heights, squares = np.einsum("ki,ki->k", normals, points), np.square(points).sum(axis=1)
    found = np.empty((len(camera), len(points)), dtype=bool)
    for row, c, axis, depth in zip(found, camera, axes, least, strict=True):  # an epoch stays in the cache
        distance = np.sqrt(points @ (-2.0 * c) + squares + c @ c)
        np.greater(normals @ c - heights, cosine * distance, out=row)
        row &= points @ axis > depth
    return found


def recognised(
    visible: Bool[np.ndarray, "n k"], drawn: Float[np.ndarray, "a k"], probability: Float[np.ndarray, " k"]
) -> Bool[np.ndarray, "n k"]:
    """The visible landmarks of those appearances in which they are known again.

    Parameters
    ----------
    drawn : Float[np.ndarray, 'a k']
        Of appearance a of landmark k at (a, k), compared with the landmark's probability; a row for each appearance.
    """
    library, count = _library(), visible.shape[1]
    if library is None:
        return _recognised_in_numpy(visible, drawn, probability)
    given = [np.ascontiguousarray(each) for each in (visible, drawn, probability)]
    appearances, now, found = np.zeros(count, np.int64), np.zeros(count, bool), np.empty_like(given[0])
    begun = np.empty(count + 1, np.int64)
    library.recognised(*visible.shape, *map(address, (*given, appearances, now, begun, found)))
    return found


def _recognised_in_numpy(
    visible: Bool[np.ndarray, "n k"], drawn: Float[np.ndarray, "a k"], probability: Float[np.ndarray, " k"]
) -> Bool[np.ndarray, "n k"]:
    known, appearances = np.empty_like(visible), np.zeros(visible.shape[1], dtype=np.intp)
    now, before = np.zeros((2, visible.shape[1]), dtype=bool)
    for row, seen in zip(known, visible, strict=True):
        new = np.flatnonzero(seen & ~before)
        now[new] = drawn[appearances[new], new] < probability[new]
        appearances[new] += 1
        np.logical_and(seen, now, out=row)
        before = seen
    return known


@cache
def _library() -> ctypes.PyDLL | None:
    text = files("spinfilters.models").joinpath("visibility.c").read_text()
    return with_signatures(load_text("visibility", text, _FLAGS), _SIGNATURES)


RIG = StereoRig(PinholeCamera(fx=466.7, fy=466.7, cx=320.0, cy=240.0, width=640, height=480), baseline_m=0.09)
"""The Goggles' cameras (Tweddle 2013, Tables 5.1 and 5.4)."""

DEPTHS = (0.65, 1.5)
"""Smallest and largest depth, over the first one, of a body that stays in view."""


class TrueMotion(Protocol):
    """A simulated motion (`spinfilters.simulation.scenario.Motion`): states (n, mean_dim) of one layout at ``time`` (n,) s."""

    @property
    def layout(self) -> StateLayout:
        """Blocks of the states."""
        ...

    @property
    def time(self) -> Float[np.ndarray, " n"]:
        """(n,) of the epochs, s."""
        ...

    @property
    def states(self) -> Float[np.ndarray, "n m"]:
        """(n, mean_dim) true states."""
        ...

    @property
    def rotations(self) -> Float[np.ndarray, "n 3 3"]:
        """(n, 3, 3) R_ig."""
        ...

    def block(self, name: str) -> Float[np.ndarray, "n b"]:
        """(n, dimension) of one block."""
        ...


class Recognition(Protocol):
    """Re-detection model of the landmarks in view."""

    def known(
        self, visible: Bool[np.ndarray, "n k"], generator: np.random.Generator
    ) -> Bool[np.ndarray, "n k"]:
        """The visible landmarks (frame by landmark) whose track goes on."""
        ...


@dataclass(frozen=True)
class EveryAppearance:
    """Re-detection of every landmark whenever it comes into view."""

    def known(
        self, visible: Bool[np.ndarray, "n k"], generator: np.random.Generator
    ) -> Bool[np.ndarray, "n k"]:
        """All that are visible."""
        return visible


@dataclass(frozen=True)
class SomeAppearances:
    """Re-detection model that decides for whole appearances of a landmark.

    The probability is the landmark's own, drawn from the Beta distribution with shapes ``alpha`` and ``beta``: few landmarks
    are distinct enough to be known again at every revolution.
    """

    alpha: float
    beta: float

    def __post_init__(self) -> None:
        if not (self.alpha > 0 and self.beta > 0):
            raise InputError(
                f"shapes {self.alpha}, {self.beta} of the Beta distribution of recognition must be positive"
            )

    def known(
        self, visible: Bool[np.ndarray, "n k"], generator: np.random.Generator
    ) -> Bool[np.ndarray, "n k"]:
        """The visible landmarks of those appearances in which they are known again."""
        probability = generator.beta(self.alpha, self.beta, visible.shape[1])
        return recognised(visible, _draw_appearances(visible, generator), probability)


def _draw_appearances(
    visible: Bool[np.ndarray, "n k"], generator: np.random.Generator
) -> Float[np.ndarray, "a k"]:
    """Uniform numbers of as many appearances as the landmarks have, of the first rows of one for every frame and landmark.

    The generator goes on behind the last of all rows.
    """
    epochs, count = visible.shape
    begun = visible[0] + np.count_nonzero(visible[1:] > visible[:-1], axis=0)
    appearances = int(begun.max(initial=0))
    bits: Any = generator.bit_generator
    if bits.state["bit_generator"] != "PCG64":  # of another, a number may take several steps
        return generator.random(visible.shape)[:appearances]
    drawn = generator.random((appearances, count))
    bits.advance((epochs - appearances) * count)
    return drawn


@dataclass(frozen=True)
class FrontEnd:
    """Options of the simulated front end.

    Attributes
    ----------
    pixel_std : float
        White noise of each pixel coordinate, px.
    detection : float
        Probability that a landmark in view, and known, is found in a frame.
    facing_cosine : float
        a landmark is in view when the cosine between its outward normal and the line to the camera exceeds this.
    recognition : Recognition
        Which landmarks in view are known again.
    fewest_observations : int
        Landmarks with fewer in the whole recording are left out, and the others numbered anew.
    """

    pixel_std: float = 1.0
    detection: float = 0.9
    facing_cosine: float = 0.35
    recognition: Recognition = field(default_factory=EveryAppearance)
    fewest_observations: int = 0

    def __post_init__(self) -> None:
        if not 0 < self.detection <= 1:
            raise InputError(f"detection {self.detection} must lie in (0, 1]")
        if not (-1 <= self.facing_cosine < 1 and self.fewest_observations >= 0):
            raise InputError(
                f"facing_cosine {self.facing_cosine} must lie in [-1, 1) and fewest_observations "
                f"{self.fewest_observations} be at least 0"
            )


def ball(count: int, radius_m: float, generator: np.random.Generator) -> Surface:
    """Landmarks on a slightly dented ball about the origin of g."""
    normals, depths = draw_ball(count, generator)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return Surface(radius_m * depths * normals, normals)


def draw_ball(
    count: int, generator: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 1"]]:
    """The random numbers of a `ball`: directions of its landmarks, and their distances in radii."""
    return generator.standard_normal((count, 3)), generator.uniform(0.8, 1.0, (count, 1))


def pass_ball(room: Float[np.ndarray, " _"], generator: np.random.Generator) -> None:
    """Draw what `draw_ball` draws where nobody needs it; the room is of four numbers a landmark."""
    generator.standard_normal(out=room[: 3 * (len(room) // 4)])
    generator.random(out=room[3 * (len(room) // 4) :])


def stays_in_view(motion: TrueMotion, radius_m: float) -> bool:
    """Whether a ball about g stays whole in both images throughout, at about its first depth (`DEPTHS`)."""
    path = motion.block("t")
    return could_stay_in_view(path, float(path[0, 2]), radius_m, 0.0)


def could_stay_in_view(
    path: Float[np.ndarray, "n 3"], first_depth: float, radius_m: float, margin_m: float
) -> bool:
    """Whether a ball may stay whole in both images if its centre's path (camera frame) errs by at most ``margin_m``."""
    x, y, z = path.T
    farthest = z + margin_m
    inside = (farthest > DEPTHS[0] * first_depth) & (z - margin_m < DEPTHS[1] * first_depth)
    half_width, half_height = _half_sizes()
    reach, nearest = radius_m - margin_m, farthest - radius_m
    inside &= np.maximum(x, RIG.baseline_m - x) + reach < half_width * nearest
    inside &= np.abs(y) + reach < half_height * nearest
    return bool(inside.all())


@cache
def _half_sizes() -> tuple[float, float]:
    """Half sizes of the image of `RIG` at a depth of 1 m, m."""
    corner = np.array([RIG.left.width, RIG.left.height], dtype=float)
    half_width, half_height, _ = Monocular().rays_of(corner, RIG.left.calibration).tolist()
    return half_width, half_height


@dataclass(frozen=True)
class TrackCamera:
    """A camera as its model projects landmarks.

    Attributes
    ----------
    model : MeasurementModel
        Over the layout of the motion.
    parameters : Float[np.ndarray, 'k p']
        (k, p) of all landmarks.
    rig : Rig
        With the size of the images.
    horizontal : tuple[int, ...]
        Columns of a value along the width of an image; column 1 is along its height.
    """

    model: MeasurementModel
    parameters: Float[np.ndarray, "k p"]
    rig: Rig
    horizontal: tuple[int, ...] = (0,)

    def sees(self, pixels: Float[np.ndarray, "*n k v"]) -> Bool[np.ndarray, "*n k"]:
        """Whether every image holds its pixel."""
        u, v = pixels[..., list(self.horizontal)], pixels[..., 1]
        inside = (u.min(axis=-1) >= 0) & (u.max(axis=-1) < self.rig.left.width)
        return inside & (v >= 0) & (v < self.rig.left.height)


class FeatureTracks(NamedTuple):
    """Observations (n rows) in order of time, and the rows of the surface that landmarks 0, 1, 2 ... are."""

    time: Float[np.ndarray, " n"]
    ids: Int[np.ndarray, " n"]
    values: Float[np.ndarray, "n v"]
    landmarks: Int[np.ndarray, " m"]


def draw_detections(
    known: Bool[np.ndarray, "n k"], detection: float, value_dim: int, generator: np.random.Generator
) -> tuple[Int[np.ndarray, " f"], Int[np.ndarray, " n"], Float[np.ndarray, "f v"]]:
    """Landmarks that are found, epoch after epoch, how many in each, and standard normal errors of their values."""
    library, fill = _library(), _normal_fill()
    if library is not None and fill is not None:
        return _compiled_detections(library, fill, known, detection, value_dim, generator)
    drawn, ids, noise = np.empty(known.shape[1]), [], []
    counts = known.sum(axis=1)
    # places in the flat mask less those of their rows' begins: NumPy looks through a flat mask eight times as fast
    where = np.flatnonzero(known) - np.repeat(known.shape[1] * np.arange(len(known)), counts)
    ends = np.cumsum(counts).tolist()
    for begin, end in pairwise([0, *ends]):
        row = where[begin:end]
        found = row[generator.random(out=drawn)[row] < detection]
        ids.append(found)
        noise.append(generator.standard_normal((found.size, value_dim)))
    return np.concatenate(ids), np.array([len(found) for found in ids]), np.concatenate(noise)


def _compiled_detections(
    library: ctypes.PyDLL,
    fill: int,
    known: Bool[np.ndarray, "n k"],
    detection: float,
    value_dim: int,
    generator: np.random.Generator,
) -> tuple[Int[np.ndarray, " f"], Int[np.ndarray, " n"], Float[np.ndarray, "f v"]]:
    """`draw_detections` by one call, with NumPy's own normals."""
    most, bits, plain = int(np.count_nonzero(known)), generator.bit_generator, np.ascontiguousarray(known)
    ids, noise = np.empty(most + 1, np.int64), np.empty((most, value_dim))  # one more: see the loop
    counts = np.empty(len(known), np.int64)
    with bits.lock:
        library.detections(
            *(bits.ctypes.bit_generator, fill, *known.shape, address(plain)),
            *(detection, value_dim, address(ids), address(noise), address(counts)),
        )
    total = int(counts.sum())
    return ids[:total], counts, noise[:total]


@cache
def _normal_fill() -> int | None:
    """Address of the function by which NumPy's generators draw standard normals; None where it is not exported."""
    try:
        exported = ctypes.CDLL(np.random._generator.__file__).random_standard_normal_fill
    except (AttributeError, OSError):
        return None
    return ctypes.cast(exported, ctypes.c_void_p).value


def feature_tracks(
    camera: TrackCamera,
    front_end: FrontEnd,
    surface: Surface,
    motion: TrueMotion,
    generator: np.random.Generator,
) -> FeatureTracks:
    """Tracks over a motion.

    Raises
    ------
    InputError
        When no landmark is ever found.
    """
    visible = facing(front_end.facing_cosine, surface, motion.rotations, motion.block("t"))
    if not _all_in_view(camera, surface, motion):
        for row, x in zip(visible, motion.states, strict=True):
            rows = np.flatnonzero(row)
            row[rows] = camera.sees(camera.model.predict(x, camera.parameters[rows]))
    known = front_end.recognition.known(visible, generator)
    every, counts, noise = draw_detections(known, front_end.detection, camera.model.value_dim, generator)
    epochs = np.repeat(np.arange(len(counts)), counts)
    enough = np.bincount(every, minlength=len(surface.points)) >= front_end.fewest_observations
    rows = enough[every].nonzero()[0]
    if not rows.size:
        raise InputError(
            "no landmark is ever visible; move the body into the camera's view (range_m, velocity)"
        )
    landmarks, epochs = every[rows], epochs[rows]
    values = camera.model.predict_each(motion.states, epochs, camera.parameters, landmarks)
    values += front_end.pixel_std * noise[rows]
    numbers = np.cumsum(enough) - 1
    return FeatureTracks(motion.time[epochs], numbers[landmarks], values, enough.nonzero()[0])


def _all_in_view(camera: TrackCamera, surface: Surface, motion: TrueMotion) -> bool:
    """Whether no landmark can leave the images, because a ball around all of them does not."""
    radius = float(np.linalg.norm(surface.points, axis=1).max(initial=0.0))
    return camera.rig == RIG and stays_in_view(motion, radius)
