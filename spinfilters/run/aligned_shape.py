"""A run's dense model on a known shape, which gives centre of mass and inertia in its axes (Tweddle 2013, Eqs 6.21 to 6.27)."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from spinfilters.core.attitude_conversions import cross_matrix
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text
from spinfilters.io.output_files import write_json
from spinfilters.lidar.mesh import read_mesh
from spinfilters.lidar.registration import Registration
from spinfilters.lidar.shape_alignment import (
    KNOWN,
    determines_pose,
    facet_cloud,
    fitting_poses,
    surface_cloud,
)
from spinfilters.models.body import BodyEstimate
from spinfilters.run.array_files import finite_document
from spinfilters.run.run_folder import (
    ALIGNMENT_FILE,
    ALIGNMENT_PICTURE,
    MODEL_FILE,
    RECONSTRUCTION_FOLDER,
    read_figure_data,
)

SCHEMA: Final = 1
SIZES: Final = (0.5, 2.0)
"""Size of the known shape over that of the model, beyond which its unit is another one."""
LEAST_OVERLAP: Final = 0.3
"""Share of the model that must lie on the shape."""
FAR: Final = 0.03
"""Root-mean-square distance over the size of the shape, above which both may be of different bodies."""
SEED: Final = 0
"""Of the points drawn on the shape."""


@dataclass(frozen=True, eq=False)
class AlignedShape:
    """A dense model in the axes of a known shape.

    Attributes
    ----------
    document : dict[str, Any]
        What `ALIGNMENT_FILE` holds.
    known, moved : ndarray of shape (n, 3) and (m, 3)
        Points of the shape and of the model on it, m.
    """

    document: dict[str, Any]
    known: Float[np.ndarray, "n 3"]
    moved: Float[np.ndarray, "m 3"]


def align_shape(folder: Path, shape: Path, scale: float = 1.0) -> AlignedShape:
    """Align a run's dense model to a mesh, and write both numbers and picture beside the model.

    Parameters
    ----------
    folder : Path
        Of the run, with a dense model.
    shape : Path
        Mesh of the body.
    scale : float
        Length of the mesh's unit, m.

    Raises
    ------
    InputError
        No run, no dense model; no mesh, one of another size; a shape on which the model does not lie.
    """
    path = folder / RECONSTRUCTION_FOLDER / MODEL_FILE
    figure_data = read_figure_data(folder)
    if not path.is_file():
        raise InputError(
            f"{path_text(folder)}: has no dense model; make it with spinfilters reconstruct {folder}"
        )
    evaluation = figure_data.most_exact
    if evaluation is None:
        raise InputError(f"{path_text(folder)}: all its estimators have failed; look at their reasons")
    known = surface_cloud(read_mesh(shape).scaled(scale), KNOWN, np.random.default_rng(SEED))
    source = facet_cloud(read_mesh(path))
    _require_like_size(known.size / source.size, scale, folder, shape)
    found = fitting_poses(source, known)
    if not found or found[0].overlap < LEAST_OVERLAP:
        share = 100 * found[0].overlap if found else 0.0
        raise InputError(
            f"{path_text(shape)}: at most {share:.0f} % of the model of {path_text(folder)} lies on it; give the shape of that body"
        )
    if not determines_pose(found[0], known.size):
        raise InputError(
            f"{path_text(folder)}: its dense model shows too little of the body, so that it can slide or turn on "
            f"{path_text(shape)}; record more of its sides"
        )
    document = {"shape": shape.name, "scale": scale, "estimator": evaluation.name}
    document |= _describe(found, evaluation.body, known.size)
    best = found[0]
    made = AlignedShape(document, known.points, source.points @ best.rotation.T + best.translation)
    _write(path.parent, made)
    return made


def _require_like_size(ratio: float, scale: float, folder: Path, shape: Path) -> None:
    """InputError: the shape is so many times as large as the model that its unit is another one."""
    if SIZES[0] < ratio < SIZES[1]:
        return
    likely = scale * 10.0 ** -round(np.log10(ratio))
    cure = f"give --scale {likely:g}" if likely != scale else "give the length of its unit with --scale"
    raise InputError(
        f"{path_text(shape)}: is {ratio:.3g} times as large as the model of {path_text(folder)}; {cure}"
    )


def _describe(found: list[Registration], body: BodyEstimate, size: float) -> dict[str, Any]:
    """Numbers of the best pose with their standard deviations, and the other poses."""
    best = found[0]
    R, t = best.rotation, best.translation
    aligned = np.linalg.inv(best.information)
    # errors of the model's own axes and origin, rotated into those of the shape, beside those of the alignment
    A = body.principal_axes_g
    centre_std = np.full(3, np.nan) if body.center_of_mass_std is None else body.center_of_mass_std
    centre_cov = aligned[3:, 3:] + R @ A @ np.diag(centre_std**2) @ A.T @ R.T
    rotation_cov = aligned[:3, :3] + R @ body.principal_axes_cov @ R.T
    J = R @ np.diag(body.principal_moments) @ R.T
    centre = np.zeros(3) if body.center_of_mass_g is None else body.center_of_mass_g
    return {
        "schema": SCHEMA,
        "rotation": R.tolist(),
        "rotation_std_deg": np.degrees(np.sqrt(np.diag(rotation_cov))).tolist(),
        "center_of_mass_m": t.tolist(),
        "center_of_mass_std_m": np.sqrt(np.diag(centre_cov)).tolist(),
        "principal_axes": R.T.tolist(),
        "principal_moments": body.principal_moments.tolist(),
        "inertia": J.tolist(),
        "inertia_std": _inertia_std(J, R, body.principal_moments_cov, rotation_cov).tolist(),
        "g_to_shape": {"rotation": (R @ A).tolist(), "translation_m": (t - R @ A @ centre).tolist()},
        "distance_rms_m": best.residual_std,
        "overlap": best.overlap,
        "other_rotations": [each.rotation.tolist() for each in found[1:]],
        "notes": _notes(found, size),
    }


def _inertia_std(
    J: Float[np.ndarray, "3 3"],
    R: Float[np.ndarray, "3 3"],
    moments_cov: Float[np.ndarray, "3 3"],
    rotation_cov: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "3 3"]:
    """Standard deviations of the entries of J = R diag(m) R', by dJ = R diag(dm) R' + [phi x] J - J [phi x]."""
    by_moment = np.einsum("ik,jk->kij", R, R)
    turns = cross_matrix(np.eye(3))
    by_turn = turns @ J - J @ turns
    variance = np.einsum("kij,kl,lij->ij", by_moment, moments_cov, by_moment)
    variance += np.einsum("kij,kl,lij->ij", by_turn, rotation_cov, by_turn)
    return np.sqrt(np.maximum(variance, 0.0))


def _notes(found: list[Registration], size: float) -> list[str]:
    notes = []
    if found[1:]:
        notes.append(
            f"{len(found) - 1} other rotations fit as well, since the shape is symmetric or the model shows too little of it: "
            "the axes are those of one of them"
        )
    if found[0].residual_std > FAR * size:
        notes.append(
            f"the model is {1e3 * found[0].residual_std:.2g} mm from the shape on average: it may be another body's"
        )
    return notes


def _write(place: Path, made: AlignedShape) -> None:
    from spinfilters.plots.reference_figures import slices_figure
    from spinfilters.plots.style import draw_figure

    title = f"Dense model on {made.document['shape']}"
    draw_figure(lambda: slices_figure(made.known, made.moved, title), place / ALIGNMENT_PICTURE)
    write_json(place / ALIGNMENT_FILE, finite_document(made.document))
