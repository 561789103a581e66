"""Commands of ``spinfilters``, one file each, in the order of the help.

A command's file is imported when the command is used or asked for its help: all records of arguments take longer to make than the
rest of ``spinfilters --help``. One more command is a file, with the record of its arguments, the function that runs it and its
``COMMAND``, and a line here (docs/how-to/add-a-command.md).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from spinfilters.cli.command import Command, CommandGroup


class ListedCommand(NamedTuple):
    """A command in the table: its name, one line of help, and the module whose ``COMMAND`` it is."""

    name: str
    help: str
    module: str

    def load(self) -> "Command[Any] | CommandGroup":
        """Import its module."""
        return import_module(self.module).COMMAND


COMMANDS: Final = (
    ListedCommand("compare", "estimators side by side on one recording", "spinfilters.cli.commands.compare"),
    ListedCommand("estimate", "one estimator on a recording", "spinfilters.cli.commands.estimate"),
    ListedCommand("segments", "list the free flights of a recording", "spinfilters.cli.commands.segments"),
    ListedCommand(
        "live",
        "filter and smoother side by side on measurements as they arrive",
        "spinfilters.cli.commands.live",
    ),
    ListedCommand(
        "calibrate", "stereo calibration from images of a board", "spinfilters.cli.commands.calibrate"
    ),
    ListedCommand(
        "checkout",
        "check a stored calibration on new images, or compare it with another",
        "spinfilters.cli.commands.checkout",
    ),
    ListedCommand(
        "rig", "how well a stereo rig can measure, before it is built", "spinfilters.cli.commands.rig"
    ),
    ListedCommand(
        "unpack",
        "images and clouds of bags, videos of a stereo pair, as data sets",
        "spinfilters.cli.commands.unpack",
    ),
    ListedCommand("track", "stereo images to tracks of landmarks", "spinfilters.cli.commands.track"),
    ListedCommand(
        "depth", "disparity and depth of one stereo pair, local and global", "spinfilters.cli.commands.depth"
    ),
    ListedCommand(
        "reconstruct",
        "dense model of the body, from a run on stereo images",
        "spinfilters.cli.commands.reconstruct",
    ),
    ListedCommand(
        "simulate",
        "write a simulated data set with truth, and a picture of it",
        "spinfilters.cli.commands.simulate",
    ),
    ListedCommand(
        "lidar", "simulate scans of a body, estimate how many are needed", "spinfilters.cli.commands.lidar"
    ),
    ListedCommand(
        "observe",
        "what sensors can determine of a motion, with proof, and how well",
        "spinfilters.cli.commands.observe",
    ),
    ListedCommand(
        "campaign", "run a table of factors times seeds, and report", "spinfilters.cli.commands.campaign"
    ),
    ListedCommand(
        "study",
        "filters beside smoothers: which to fly when, with intervals",
        "spinfilters.cli.commands.ready_studies",
    ),
    ListedCommand(
        "calibration",
        "test by simulation whether truths lie in stated posteriors as often as they should",
        "spinfilters.cli.commands.simulated_calibration",
    ),
    ListedCommand(
        "condition",
        "conditioning of covariances by time step and units",
        "spinfilters.cli.commands.condition",
    ),
    ListedCommand(
        "polhode",
        "free rotation of a body with given moments: polhode, herpolhode, cones, stability",
        "spinfilters.cli.commands.free_spin",
    ),
    ListedCommand(
        "threshold",
        "whether a target tumbles or spins, for a mission's thrust and propellant",
        "spinfilters.cli.commands.threshold",
    ),
    ListedCommand(
        "reproduce",
        "tables and figures of the sources: printed, ours, bound",
        "spinfilters.cli.commands.reproduce",
    ),
    ListedCommand("embed", "write the filter as C for a microcontroller", "spinfilters.cli.commands.embed"),
    ListedCommand("plot", "draw the figures of a run folder again", "spinfilters.cli.commands.plot"),
    ListedCommand(
        "schema", "JSON Schema of settings, studies and summary.json", "spinfilters.cli.commands.schema"
    ),
    ListedCommand(
        "completion", "complete words of these commands in a shell", "spinfilters.cli.commands.completion"
    ),
    ListedCommand(
        "doctor", "print versions and check that everything works", "spinfilters.cli.commands.doctor"
    ),
)

COMMAND_GROUPS: Final[dict[str, tuple[str, ...]]] = {
    "estimate": ("compare", "estimate", "segments", "live", "plot"),
    "make data": (
        "simulate",
        "lidar",
        "unpack",
        "track",
        "calibrate",
        "checkout",
        "depth",
        "rig",
        "reconstruct",
    ),
    "study": (
        "observe",
        "campaign",
        "study",
        "calibration",
        "condition",
        "polhode",
        "threshold",
        "reproduce",
    ),
    "deliver": ("embed", "schema", "completion", "doctor"),
}
"""Commands by what they are for, as ``spinfilters --help`` lists them; others stand behind these."""
