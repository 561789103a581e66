"""Commands of ``spinfilters``, one file each, in the order of the help.

Nothing heavy is imported here, so that help is quick. One more command is a file with its parser and its function, and a name here.
"""

from typing import Final

from spinfilters.cli.command import Command
from spinfilters.cli.commands import (
    calibrate,
    campaign,
    compare,
    condition,
    doctor,
    embed,
    live,
    observe,
    plot,
    reconstruct,
    rig,
    scanning,
    segments,
    simulate,
    track,
)

COMMANDS: Final[tuple[Command, ...]] = (
    compare.COMPARE,
    compare.ESTIMATE,
    segments.SEGMENTS,
    live.LIVE,
    calibrate.CALIBRATE,
    rig.RIG,
    track.TRACK,
    reconstruct.RECONSTRUCT,
    simulate.SIMULATE,
    scanning.LIDAR,
    observe.OBSERVE,
    campaign.CAMPAIGN,
    condition.CONDITION,
    embed.EMBED,
    plot.PLOT,
    doctor.DOCTOR,
)
