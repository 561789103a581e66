"""The command ``calibrate``: a stereo calibration from images of a board, and its checkout."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from spinfilters.cli.command import Command
from spinfilters.cli.common_options import FigureOptions, draw, print_json_file
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import path_text
from spinfilters.vision.calibration_arguments import CalibrateArguments

if TYPE_CHECKING:
    from spinfilters.vision.image_folder import LossCount
    from spinfilters.vision.stereo_calibration import CheckResult, StereoCalibration


def calibrate(options: CalibrateArguments) -> int:
    """Calibrate a stereo pair; write and print the result. Exit code 1 where a check fails."""
    from spinfilters.io.output_files import output_folder, refuse_foreign
    from spinfilters.vision.calibration_images import Board, board_views, image_pairs
    from spinfilters.vision.image_folder import LossCount
    from spinfilters.vision.stereo_calibration import (
        calibrate_stereo,
        checks,
        determination,
        measured_board,
        write_calibration,
    )

    source, folder, losses = Path(options.folder), Path(options.output), LossCount()
    board = Board.of(options.corners, options.square, options.charuco, options.window)
    refuse_foreign(folder, COMMAND.name)
    pairs = image_pairs(source)
    views, size = board_views(pairs, board, losses)
    try:
        found = calibrate_stereo(views, board, size)
    except InputError as error:
        raise InputError(f"{path_text(source)}: {error}") from None
    try:
        measured = measured_board(found.rig, found.views, board)
    except InputError as error:  # left and right exchanged, as a whole
        raise InputError(f"{path_text(source)}: {error} (left* is cam0)") from None
    results = [*determination(found), *checks(found.rig, measured, board)] if options.check else []
    with output_folder(folder, COMMAND.name) as place:
        write_calibration(place, found, measured, results, losses)
        if options.check:
            used = {view.name for view in found.views}
            pair = next(pair for pair in pairs if pair[0].name in used)
            draw(lambda: _figure(found, *pair), place / "check.png")
    _print(found, results, losses, options.window, folder)
    print_json_file(folder / "calibration.json")
    return 0 if all(result.passed for result in results) else 1


def _figure(found: "StereoCalibration", left_path: Path, right_path: Path) -> Any:
    from spinfilters.plots.measurement_figures import calibration_figure
    from spinfilters.vision.depth_map import disparity_map
    from spinfilters.vision.image_folder import read_image
    from spinfilters.vision.rectification import Rectification

    rectification = Rectification(found.rig)
    (left, _), (right, _) = read_image(left_path), read_image(right_path)
    assert left is not None  # the board was seen in both
    assert right is not None
    images = rectification.images(left, right)
    return calibration_figure(
        *images, disparity_map(*images, largest=found.rig.left.width // 4), found.view_errors
    )


def _print(
    found: "StereoCalibration", results: "list[CheckResult]", losses: "LossCount", window: int, folder: Path
) -> None:
    from spinfilters.cli.console import wide_console
    from spinfilters.vision.stereo_calibration import (
        LARGEST_RELATIVE_STD,
        standing_out,
        undetermined,
        undetermined_text,
    )

    lines = losses.sentences()
    for name, camera in zip(("left", "right"), found.cameras, strict=True):
        K, std = camera.K, camera.std
        lines.append(
            f"{name}: fx {K[0, 0]:.2f} +- {std['fx']:.2f}, fy {K[1, 1]:.2f} +- {std['fy']:.2f}, "
            f"centre {K[0, 2]:.2f}, {K[1, 2]:.2f} px; "
            f"rms {camera.rms:.3f} px"
        )
    lines.append(
        f"pair: baseline {1e3 * found.baseline:.2f} +- {1e3 * found.baseline_std:.2f} mm; "
        f"rms {found.rms:.3f} px, {len(found.views)} views"
    )
    lines += [f"left out: {name}: {why}" for name, why in found.dropped.items()]
    if found.repeated:
        first = next(iter(found.repeated.items()))
        lines.append(
            f"counted as one: {len(found.repeated)} views show the board where another does ({first[0]} as {first[1]})"
        )
    if not results:  # the checks say it themselves
        lines += [
            undetermined_text(what, deviation)
            for what, deviation in undetermined(found, LARGEST_RELATIVE_STD)
        ]
    lines += [f"{why}; try --window {max(3, 2 * window // 3)}" for why in standing_out(found)]
    lines += [
        f"{'ok  ' if result.passed else 'BAD '} {result.name}: {result.value} ({result.allowed})"
        for result in results
    ]
    for line in [*lines, f"calibration in {folder}"]:
        wide_console().print(line, highlight=False, soft_wrap=True)


COMMAND = Command(
    "calibrate",
    CalibrateArguments,
    calibrate,
    "Images are named left* and right*, or lie in the EuRoC layout. Writes cam0/sensor.yaml and cam1/sensor.yaml for track, "
    "and opencv.yml. The file calibration.json has the uncertainty of every parameter, the error of every image, and the rejected "
    "views with the reason.",
    common=FigureOptions,
)
