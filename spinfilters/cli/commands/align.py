"""The command ``align``: the dense model of a run on a known shape."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import PrintingOptions, print_document
from spinfilters.io.stated_values import Argument, NumberRange

if TYPE_CHECKING:
    from spinfilters.run.aligned_shape import AlignedShape


@dataclass(frozen=True, kw_only=True)
class AlignArguments:
    """Arguments of ``align``."""

    run: Annotated[
        str, Argument("run folder with a dense model, made by reconstruct", positional=True, metavar="RUN")
    ]
    shape: Annotated[
        str, Argument("mesh of the body: .stl, .obj, .ply or .tab", positional=True, metavar="SHAPE")
    ]
    scale: Annotated[
        float, NumberRange(1e-9, 1e9), Argument("length of the mesh's unit in m, 0.001 for mm", metavar="M")
    ] = 1.0


def align(options: AlignArguments) -> int:
    """Write the alignment beside the model, and print it."""
    from spinfilters.run.aligned_shape import align_shape
    from spinfilters.run.run_folder import refuse_foreign_run
    from spinfilters.run.run_lock import locked_run
    from spinfilters.run.run_summary import read_summary

    folder = Path(options.run)
    read_summary(folder)
    refuse_foreign_run(folder)
    with locked_run(folder):
        made = align_shape(folder, Path(options.shape), options.scale)
    _print(made, folder)
    print_document(made.document)
    return 0


def _print(made: "AlignedShape", folder: Path) -> None:
    from spinfilters.cli.console import wide_console
    from spinfilters.run.run_folder import ALIGNMENT_PICTURE, RECONSTRUCTION_FOLDER

    told = made.document
    places = zip("xyz", told["center_of_mass_m"], told["center_of_mass_std_m"], strict=True)
    lines = [
        f"model on {told['shape']}: {1e3 * told['distance_rms_m']:.2g} mm root mean square, {100 * told['overlap']:.0f} % of it",
        "centre of mass in the axes of the shape: "
        + ", ".join(f"{axis} {1e3 * value:.2f} +- {1e3 * std:.2g} mm" for axis, value, std in places),
    ]
    names = ("minor", "intermediate", "major")
    for name, axis in zip(names, told["principal_axes"], strict=True):
        lines.append(f"{name} axis: {', '.join(f'{each:+.4f}' for each in axis)}")
    lines.append(
        "rotations about the axes of the shape are known to "
        + ", ".join(f"{each:.2g}" for each in told["rotation_std_deg"])
        + " deg"
    )
    lines += [*told["notes"], f"look at {folder / RECONSTRUCTION_FOLDER / ALIGNMENT_PICTURE}"]
    for line in lines:
        wide_console().print(line, highlight=False, soft_wrap=True)


COMMAND = Command(
    "align",
    AlignArguments,
    align,
    "Aligns the dense model of a run to a mesh of the body, from any rotation. Writes RUN/reconstruction/alignment.json (centre of "
    "mass, principal axes and inertia in the axes of the shape, with standard deviations; other rotations that fit as well) and "
    "alignment.png (slices of both).",
    common=PrintingOptions,
)
