"""NumPy archives of a run without pickle, and the history of an estimator in one."""

import io
import json
import lzma
import math
import tokenize
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any
from zipfile import ZIP_DEFLATED, ZIP_STORED, BadZipFile, ZipFile

import numpy as np
from jaxtyping import Float, Int

from spinfilters.core.errors import InputError, ShapeError
from spinfilters.core.large_arrays import release_pages
from spinfilters.filters.history import EPOCH_ARRAYS, EstimateHistory, checked_epochs
from spinfilters.io.input_file import ignored_warnings, path_text, reason, require_file
from spinfilters.io.output_files import atomic_file
from spinfilters.models.body import MassSamples
from spinfilters.models.state_layout import StateLayout
from spinfilters.models.state_mixture import ErrorMixture
from spinfilters.models.status import ALL, OWN_STATUS, EstimatorStatus, Finding, Holds, Verdict

LARGEST_FILE = 2 << 30
"""Bytes, of the file and of everything in it together."""
MOST_ARRAYS, LARGEST_RATIO, SMALL = 10_000, 50, 1 << 20
"""Bounds of what a file unpacks to: histories shrink to a third when packed, a bomb to a thousandth."""
PIECE = 1 << 17
"""Elements of an array that are written at a time."""
COMPRESSION = 1
"""Level of what is packed: doubles of a history become no smaller by the usual 6, which takes half as long again."""
RELEASED = 8
"""Pieces after which an array in a file gives its memory back."""
KINDS = "biufU"
"""Kinds of elements that a file may hold: truth values, numbers and words, never objects."""

DAMAGED = (
    OSError,
    ValueError,
    TypeError,
    KeyError,
    IndexError,
    EOFError,
    RuntimeError,  # an encrypted member; NotImplementedError and RecursionError too
    OverflowError,
    MemoryError,
    SyntaxError,
    tokenize.TokenError,
    BadZipFile,
    zlib.error,
    lzma.LZMAError,
    InputError,
)
"""What reading and interpreting a damaged or hostile file may raise; every reader makes one line of it."""


def write_arrays(path: Path, arrays: Mapping[str, np.ndarray], compression: int = ZIP_STORED) -> None:
    """Write arrays as an .npz, atomically; an array in Fortran's order keeps it.

    Parameters
    ----------
    compression : int
        `zipfile.ZIP_STORED`, or `zipfile.ZIP_DEFLATED` for a file that is written once.
    """
    with atomic_file(path) as stream, ZipFile(stream, "w", compression, compresslevel=COMPRESSION) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                _write_array(member, array)


def _write_array(member: IO[bytes], array: np.ndarray) -> None:
    """Write an array as `numpy.lib.format.write_array`, in smaller pieces."""
    header = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(member, header)
    flat = array.reshape(-1, order="F" if header["fortran_order"] else "C")
    for number, start in enumerate(range(0, len(flat), PIECE)):
        member.write(flat[start : start + PIECE].tobytes())
        if number % RELEASED == 0:
            release_pages(array)


def read_arrays(path: Path) -> dict[str, np.ndarray]:
    """Arrays of a file of `write_arrays`, of limited size, nothing evaluated.

    Raises
    ------
    one of DAMAGED: missing, too large packed or unpacked, cut off, changed, of objects. Callers make `unusable` of it.
    """
    allowed = min(LARGEST_FILE, SMALL + LARGEST_RATIO * require_file(path, LARGEST_FILE))
    with ZipFile(path) as archive:
        members = archive.infolist()
        unpacked = sum(member.file_size for member in members)
        if unpacked > allowed or len(members) > MOST_ARRAYS:
            raise ValueError(f"{len(members)} arrays of {unpacked} bytes is more than such a file holds")
        if any(member.compress_type not in (ZIP_STORED, ZIP_DEFLATED) for member in members):
            raise ValueError("packed in a way that is not written here")
        return {member.filename.removesuffix(".npy"): _array(archive.read(member)) for member in members}


def unusable(path: Path, expected: str, error: Exception, cure: str) -> InputError:
    """InputError for one of `DAMAGED`."""
    own = f"{path_text(path)}: "
    if isinstance(error, InputError) and str(error).startswith(own):
        error = InputError(str(error).removeprefix(own).partition("; ")[0])
    return InputError(f"{own}is no {expected} ({reason(error)}); {cure}")


def _array(data: bytes) -> np.ndarray:
    """The array of a .npy file whose header and size agree."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in ((1, 0), (2, 0)):
        raise ValueError(f"arrays of format {version} are not written here")
    with ignored_warnings(Warning):  # of the format of Python 2: a second line to the user
        read = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, fortran, dtype = read(stream)
    held = len(data) - stream.tell()
    if dtype.kind not in KINDS or any(n < 0 for n in shape) or math.prod(shape) * dtype.itemsize != held:
        raise ValueError(f"{held} bytes are no array of {shape} {dtype}")
    return np.ndarray(shape, dtype, data, stream.tell(), order="F" if fortran else "C").copy("K")


FINDINGS, HOLDS = "findings", "holds"
INITIALISATION, OBSERVATIONS, CALIBRATION = "initialisation", "observations", "calibration"
"""Keys that files of older versions do not have, nor `FINDINGS` and `HOLDS`, and the last not those of an exact calibration."""
MASS_POINTS, MASS_WEIGHTS, MASS_FIT = "mass_points", "mass_weights", "mass_fit"
"""Samples of the mass distribution, their weights, and how the Gaussian belief fits them; of files with samples."""
MIXTURE_WEIGHTS, MIXTURE_FACTORS = "mixture_weights", "mixture_factors"
"""Several explanations of the errors after the last epoch; of files of estimates whose deviations cover them."""


def write_history(path: Path, history: EstimateHistory) -> None:
    """Write a history as an .npz of plain arrays, atomically."""
    arrays = {name: getattr(history, name) for name in EPOCH_ARRAYS}
    words = {
        "name": np.array(history.name),
        "blocks": np.array(history.layout.blocks),
        "verdict": np.array(str(history.status.verdict)),
        "reasons": np.array(history.status.reasons, dtype=str),
        FINDINGS: np.array([finding_text(each) for each in history.status.findings], dtype=str),
        HOLDS: np.array([f"{name}={state}" for name, state in history.status.holds.items()], dtype=str),
    }
    epochs = {INITIALISATION: np.array(history.initialisation)}
    if history.observations is not None:
        epochs[OBSERVATIONS] = history.observations
    if history.calibration is not None:
        epochs[CALIBRATION] = history.calibration
    if history.mass is not None:
        epochs[MASS_POINTS], epochs[MASS_WEIGHTS] = history.mass.points, history.mass.weights
        epochs[MASS_FIT] = np.array([history.mass.gaussian_shape, history.mass.gaussian_nees])
    if history.mixture is not None:
        epochs[MIXTURE_WEIGHTS], epochs[MIXTURE_FACTORS] = history.mixture.weights, history.mixture.factors
    write_arrays(path, {**arrays, **epochs, **words}, ZIP_DEFLATED)


def read_history(path: Path, cure: str = "make the run again") -> EstimateHistory:
    """Read what `write_history` wrote; nothing in the file is evaluated.

    Parameters
    ----------
    cure : str
        What to do about a file that cannot be used.

    Raises
    ------
    InputError
        Missing, too large, damaged, or arrays that do not fit together.
    """
    try:
        arrays = read_arrays(path)
        layout = StateLayout(tuple(map(str, arrays["blocks"])))
        status = _status(arrays)
        numbers, name = checked_epochs(layout, arrays), str(arrays["name"])
        if not (np.isfinite(numbers["time"]).all() and (np.diff(numbers["time"]) > 0).all()):
            raise ValueError("its time does not run forwards")
        initialisation, observations = _initialisation(arrays, numbers), _observations(arrays, numbers)
        calibration, mass = _calibration(arrays, numbers), _mass(arrays)
        mixture = _mixture(arrays, numbers)
    except DAMAGED as error:
        raise unusable(path, "history of a run", error, cure) from None
    return EstimateHistory(
        name=name,
        layout=layout,
        status=status,
        initialisation=initialisation,
        observations=observations,
        noise=(),
        calibration=calibration,
        mass=mass,
        posterior=None,
        mixture=mixture,
        **numbers,
    )


def finding_text(found: Finding) -> str:
    """A finding as JSON; numbers that are not finite are null."""
    told = {"check": found.check, "sentence": found.sentence, "cure": found.cure, "about": _about(found)}
    words = {name: value for name, value in found.numbers.items() if isinstance(value, str)}
    return json.dumps({**told, "numbers": finite_numbers(found.numbers), "words": words})


def finite_numbers(numbers: Mapping[str, float | str]) -> dict[str, float | None]:
    """Numbers of a finding as JSON holds them: None for what is not finite, no texts that stand in the sentence."""
    return {
        name: (float(value) if np.isfinite(value) else None)
        for name, value in numbers.items()
        if not isinstance(value, str)
    }


def finite_document(value: Any) -> Any:
    """A document of dictionaries, lists and numbers as JSON holds it: None for what is not finite."""
    if isinstance(value, dict):
        return {key: finite_document(each) for key, each in value.items()}
    if isinstance(value, list):
        return [finite_document(each) for each in value]
    return None if isinstance(value, float) and not np.isfinite(value) else value


def _about(found: Finding) -> list[str] | None:
    return None if found.about is None else sorted(found.about)


def _status(arrays: Mapping[str, np.ndarray]) -> EstimatorStatus:
    """Verdict, findings and what holds; of older files findings have no names. Raises ValueError, KeyError, TypeError."""
    verdict, reasons = Verdict(str(arrays["verdict"])), tuple(map(str, arrays["reasons"]))
    found = tuple(Finding(OWN_STATUS, each) for each in reasons)
    if FINDINGS in arrays:
        try:
            told = [json.loads(str(text)) for text in arrays[FINDINGS]]
            found = tuple(finding_from(each) for each, _ in zip(told, reasons, strict=True))
        except (AttributeError, RecursionError) as error:
            raise ValueError(f"its findings are damaged ({error})") from None
    pairs = [str(text).rsplit("=", 1) for text in arrays.get(HOLDS, ())]
    holds = {name: Holds(state) for name, state in pairs if name in ALL}
    return EstimatorStatus(verdict, found, holds)


def finding_from(told: Mapping[str, Any]) -> Finding:
    """A finding of the parsed JSON of `finding_text`. Raises AttributeError, KeyError, TypeError, ValueError: it is none."""
    about = None if told["about"] is None else ALL & frozenset(map(str, told["about"]))
    numbers = {
        str(name): np.nan if value is None else float(value) for name, value in told["numbers"].items()
    }
    words = {str(name): str(value) for name, value in told["words"].items()}
    return Finding(str(told["check"]), str(told["sentence"]), str(told["cure"]), {**numbers, **words}, about)


def _initialisation(arrays: Mapping[str, np.ndarray], numbers: Mapping[str, np.ndarray]) -> int:
    """Number of initialisation epochs, inferred for old files. Raises ShapeError."""
    epochs = len(numbers["time"])
    if INITIALISATION not in arrays:
        timed = np.flatnonzero(numbers["runtime"] > 0)
        return int(timed[0]) if timed.size and numbers["dof"].any() else 0
    told = arrays[INITIALISATION]
    if told.shape or told.dtype.kind != "i" or not 0 <= int(told) <= epochs:
        raise ShapeError(
            f"{INITIALISATION} is {told.dtype} of shape {told.shape}, not one of {epochs} epochs"
        )
    return int(told)


def _observations(
    arrays: Mapping[str, np.ndarray], numbers: Mapping[str, np.ndarray]
) -> Int[np.ndarray, " n"] | None:
    """Observations of every epoch; None where the file has none. Raises ShapeError."""
    told = arrays.get(OBSERVATIONS)
    if told is not None and (told.shape != numbers["time"].shape or told.dtype.kind != "i"):
        raise ShapeError(
            f"{OBSERVATIONS} is {told.dtype} of shape {told.shape}, expected a whole number per epoch"
        )
    return told


def _calibration(
    arrays: Mapping[str, np.ndarray], numbers: Mapping[str, np.ndarray]
) -> Float[np.ndarray, "n e c"] | None:
    """Errors by those of the calibration; None where the file does not hold them. Raises ShapeError."""
    told = arrays.get(CALIBRATION)
    if told is None:
        return None
    if told.ndim != 3 or told.shape[:2] != numbers["factor"].shape[:2] or told.dtype.kind != "f":
        raise ShapeError(f"{CALIBRATION} is {told.dtype} of shape {told.shape}, expected a matrix per epoch")
    return told


def _mass(arrays: Mapping[str, np.ndarray]) -> MassSamples | None:
    """Samples of the mass distribution; None where the file does not hold them. Raises KeyError, ShapeError."""
    points = arrays.get(MASS_POINTS)
    if points is None:
        return None
    weights, fit = arrays[MASS_WEIGHTS], arrays[MASS_FIT]
    shapes = points.shape[1:], weights.shape, fit.shape
    if shapes != ((5,), points.shape[:1], (2,)) or not np.isfinite(points).all() or not weights.sum() > 0:
        raise ShapeError(
            f"its samples of the mass distribution are of shapes {points.shape}, {shapes[1]}, {shapes[2]}"
        )
    return MassSamples(points, weights, float(fit[0]), float(fit[1]))


def _mixture(arrays: Mapping[str, np.ndarray], numbers: Mapping[str, np.ndarray]) -> ErrorMixture | None:
    """Explanations of the last errors; None where the file does not hold them. Raises KeyError, ShapeError."""
    weights = arrays.get(MIXTURE_WEIGHTS)
    if weights is None:
        return None
    factors, size = arrays[MIXTURE_FACTORS], numbers["factor"].shape[1:]
    fits = weights.ndim == 1 and factors.shape == (len(weights), *size)
    is_sound = fits and np.isfinite(factors).all() and (weights >= 0).all() and weights.sum() > 0
    if not is_sound:
        raise ShapeError(f"its mixture of errors is of shapes {weights.shape}, {factors.shape}")
    return ErrorMixture(weights / weights.sum(), factors)
