"""The command ``checkout``: a stored calibration against new images, or against another calibration."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, print_document
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text
from spinfilters.io.stated_values import Argument
from spinfilters.vision.calibration_arguments import CalibrateArguments, Corners, Markers, Square, Window


@dataclass(frozen=True, kw_only=True)
class CheckoutArguments:
    """Arguments of ``checkout``."""

    stored: Annotated[
        str, Argument("folder of the stored calibration (cam0, cam1)", positional=True, metavar="STORED")
    ]
    images: Annotated[
        str | None, Argument("folder with new images of the board, to check it on", metavar="FOLDER")
    ] = None
    corners: Corners = "9x6"
    square: Square = 0.0254
    charuco: Markers = False
    window: Window = CalibrateArguments.window
    difference: Annotated[
        str | None, Argument("folder of another calibration, to list what differs", metavar="OTHER")
    ] = None
    output: Annotated[str, Argument("JSON, CSV and pictures", short="-o", metavar="OUT")]


def checkout(options: CheckoutArguments) -> int:
    """Write and print a checkout, differences, or both. Exit code 1 where a check fails."""
    from spinfilters.cli.console import wide_console
    from spinfilters.io.output_files import output_folder, refuse_foreign

    if options.images is None and options.difference is None:
        raise InputError(
            "nothing to check a calibration with; give --images FOLDER, --difference OTHER or both"
        )
    folder = Path(options.output)
    refuse_foreign(folder, COMMAND.name)
    passed, lines = True, []
    document: dict[str, Any] = {}
    with output_folder(folder, COMMAND.name) as place:
        if options.images is not None:
            passed, told, document["checkout"] = _check(options, place)
            lines += told
        if options.difference is not None:
            told, document["differences"] = _differ(options, place)
            lines += told
    wide_console().print("\n".join([*lines, f"written to {folder}"]), highlight=False, soft_wrap=True)
    print_document(document)
    return 0 if passed else 1


def _check(options: CheckoutArguments, place: Path) -> tuple[bool, list[str], dict[str, Any]]:
    """Checkout on new images: its files, verdict and lines."""
    import numpy as np

    from spinfilters.io.output_files import write_json
    from spinfilters.plots.measurement_figures import checkout_figure
    from spinfilters.vision.calibration_checkout import check_stored
    from spinfilters.vision.calibration_images import Board, board_views, image_pairs
    from spinfilters.vision.depth_map import disparity_map, textured_pixels
    from spinfilters.vision.image_folder import LossCount, read_image
    from spinfilters.vision.rectification import Rectification, read_raw_rig

    rig, source, losses = read_raw_rig(Path(options.stored)), Path(str(options.images)), LossCount()
    board = Board.of(options.corners, options.square, options.charuco, options.window)
    pairs = image_pairs(source)
    views, size = board_views(pairs, board, losses)
    if size != rig.size:
        raise InputError(
            f"{path_text(source)}: images are {size[0]} x {size[1]} px, the calibration is of {rig.size[0]} x {rig.size[1]} px; "
            "give images of the calibrated cameras"
        )
    found = check_stored(rig, views, board)
    paths = next(pair for pair in pairs if pair[0].name == views[found.view].name)
    left, right = (read_image(path)[0] for path in paths)
    assert left is not None  # the board was seen in both
    assert right is not None
    images = Rectification(rig).images(left, right)
    disparity = disparity_map(*images, largest=rig.left.width // 4)
    disparity[~textured_pixels(images[0])] = np.nan
    draw(lambda: checkout_figure(found, *images, disparity), place / "checkout.png")
    document = {"passed": found.passed, "checks": [vars(result) for result in found.results]}
    write_json(place / "checkout.json", document)
    lines = losses.sentences()
    lines += [
        f"{'ok  ' if result.passed else 'BAD '} {result.name}: {result.value} ({result.allowed})"
        for result in found.results
    ]
    return found.passed, lines, document


def _differ(options: CheckoutArguments, place: Path) -> tuple[list[str], dict[str, Any]]:
    """What differs between two calibrations: its files, lines and numbers."""
    import numpy as np

    from spinfilters.io.output_files import write_text
    from spinfilters.plots.measurement_figures import calibration_changes_figure
    from spinfilters.vision.calibration_checkout import calibration_changes, read_deviations, rotation_change
    from spinfilters.vision.rectification import read_raw_rig

    first, second = Path(options.stored), Path(str(options.difference))
    rigs = read_raw_rig(first), read_raw_rig(second)
    changes = calibration_changes(*rigs, read_deviations(first), read_deviations(second))
    draw(lambda: calibration_changes_figure(changes), place / "difference.png")
    head = "parameter,unit,first,second,difference,std"
    rows = []
    for each in changes:
        numbers = (each.first, each.second, each.difference, float("nan") if each.std is None else each.std)
        rows.append(",".join([each.name, each.unit, *(f"{number:.9g}" for number in numbers)]))
    write_text(place / "difference.csv", "\n".join([head, *rows]) + "\n")
    angle, axis = rotation_change(*rigs)
    lines = [
        f"{each.name}: {each.first:.3f} -> {each.second:.3f} {each.unit}, change {each.difference:+.3f}"
        + ("" if each.std is None else f" +- {each.std:.3f}")
        for each in changes
    ]
    turned = ", ".join(f"{value:.4f}" for value in axis.tolist())
    document = {
        "parameters": [vars(each) for each in changes],
        "rotation_deg": float(np.rad2deg(angle)),
        "rotation_axis": axis.tolist(),
    }
    return [*lines, f"rotation change: {np.rad2deg(angle):.4f} deg about ({turned})"], document


COMMAND = Command(
    "checkout",
    CheckoutArguments,
    checkout,
    "With --images, the screens of a checkout before use (Tweddle 2013, sections 5.10 and 5.11): values within ranges, lines "
    "between corresponding corners, measured squares, a disparity map. With --difference: every number of two calibrations with "
    "the deviation of its change, and the rotation change as axis and angle (Table 5.5).",
    common=FigureOptions,
)
