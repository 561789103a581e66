"""Commands of ``spinfilters``, one file each, by what they are for, as the help lists them.

A command's file is imported when the command is used or asked for its help: all records of arguments take longer to make than the
rest of ``spinfilters --help``. One more command is a file, with the record of its arguments, the function that runs it and its
``COMMAND``, and a line here (docs/how-to/add-a-command.md).
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final, NamedTuple

if TYPE_CHECKING:
    from spinfilters.cli.command import Command, CommandGroup


class ListedCommand(NamedTuple):
    """A command in the table: its name, its group in the help, its one line there, and the module whose ``COMMAND`` it is."""

    name: str
    group: str
    help: str
    module: str

    def load(self) -> "Command[Any] | CommandGroup":
        """Import its module."""
        return import_module(self.module).COMMAND


COMMANDS: Final = (
    ListedCommand(
        "compare", "estimate", "estimators side by side on one recording", "spinfilters.cli.commands.compare"
    ),
    ListedCommand(
        "estimate", "estimate", "one estimator on a recording", "spinfilters.cli.commands.estimate"
    ),
    ListedCommand(
        "segments", "estimate", "list the free flights of a recording", "spinfilters.cli.commands.segments"
    ),
    ListedCommand(
        "live",
        "estimate",
        "filter and smoother side by side on measurements as they arrive",
        "spinfilters.cli.commands.live",
    ),
    ListedCommand(
        "plot", "estimate", "draw the figures of a run folder again", "spinfilters.cli.commands.plot"
    ),
    ListedCommand(
        "simulate",
        "make data",
        "write a simulated data set with truth, and a picture of it",
        "spinfilters.cli.commands.simulate",
    ),
    ListedCommand(
        "lidar",
        "make data",
        "simulate scans of a body, estimate how many are needed",
        "spinfilters.cli.commands.lidar",
    ),
    ListedCommand(
        "unpack",
        "make data",
        "images and clouds of bags, videos of a stereo pair, as data sets",
        "spinfilters.cli.commands.unpack",
    ),
    ListedCommand(
        "track", "make data", "stereo images to tracks of landmarks", "spinfilters.cli.commands.track"
    ),
    ListedCommand(
        "calibrate",
        "make data",
        "stereo calibration from images of a board",
        "spinfilters.cli.commands.calibrate",
    ),
    ListedCommand(
        "checkout",
        "make data",
        "check a stored calibration on new images, or compare it with another",
        "spinfilters.cli.commands.checkout",
    ),
    ListedCommand(
        "depth",
        "make data",
        "disparity and depth of one stereo pair, local and global",
        "spinfilters.cli.commands.depth",
    ),
    ListedCommand(
        "rig",
        "make data",
        "how well a stereo rig can measure, before it is built",
        "spinfilters.cli.commands.rig",
    ),
    ListedCommand(
        "reconstruct",
        "make data",
        "dense model of the body, from a run on stereo images",
        "spinfilters.cli.commands.reconstruct",
    ),
    ListedCommand(
        "align",
        "make data",
        "the dense model on a shape of your own: centre of mass and inertia in its axes",
        "spinfilters.cli.commands.align",
    ),
    ListedCommand(
        "observe",
        "study",
        "what sensors can determine of a motion, with proof, and how well",
        "spinfilters.cli.commands.observe",
    ),
    ListedCommand(
        "campaign",
        "study",
        "run a table of factors times seeds, and report",
        "spinfilters.cli.commands.campaign",
    ),
    ListedCommand(
        "study",
        "study",
        "filters compared with smoothers: which to fly when, with intervals",
        "spinfilters.cli.commands.ready_studies",
    ),
    ListedCommand(
        "calibration",
        "study",
        "test by simulation whether truths lie in stated posteriors as often as they should",
        "spinfilters.cli.commands.simulated_calibration",
    ),
    ListedCommand(
        "condition",
        "study",
        "conditioning of covariances by time step and units",
        "spinfilters.cli.commands.condition",
    ),
    ListedCommand(
        "fuse",
        "study",
        "one inertia of several runs of one body",
        "spinfilters.cli.commands.fuse",
    ),
    ListedCommand(
        "polhode",
        "study",
        "free rotation of a body with given moments: polhode, herpolhode, cones, stability",
        "spinfilters.cli.commands.free_spin",
    ),
    ListedCommand(
        "threshold",
        "study",
        "whether a target tumbles or spins, for a mission's thrust and propellant",
        "spinfilters.cli.commands.threshold",
    ),
    ListedCommand(
        "reproduce",
        "study",
        "tables and figures of the sources: printed, ours, bound",
        "spinfilters.cli.commands.reproduce",
    ),
    ListedCommand(
        "embed", "deliver", "write the filter as C for a microcontroller", "spinfilters.cli.commands.embed"
    ),
    ListedCommand(
        "schema",
        "deliver",
        "JSON Schema of settings, studies and summary.json",
        "spinfilters.cli.commands.schema",
    ),
    ListedCommand(
        "completion",
        "deliver",
        "complete words of these commands in a shell",
        "spinfilters.cli.commands.completion",
    ),
    ListedCommand(
        "doctor",
        "deliver",
        "print versions and check that everything works",
        "spinfilters.cli.commands.doctor",
    ),
)
