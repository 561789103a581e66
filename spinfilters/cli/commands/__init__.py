"""Commands of ``spinfilters``, one file each, in the order of the help.

Nothing heavy is imported here, so that help is quick. One more command is a file, with the record of its arguments and the function
that runs it, and a name here (docs/how-to/add-a-command.md).
"""

from typing import Any, Final

from spinfilters.cli.command import Command, CommandGroup
from spinfilters.cli.commands import (
    calibrate,
    campaign,
    compare,
    condition,
    doctor,
    embed,
    free_spin,
    live,
    observe,
    plot,
    reconstruct,
    reproduce,
    rig,
    scanning,
    segments,
    simulate,
    threshold,
    track,
)

COMMANDS: Final[tuple[Command[Any] | CommandGroup, ...]] = (
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
    free_spin.POLHODE,
    threshold.THRESHOLD,
    reproduce.REPRODUCE,
    embed.EMBED,
    plot.PLOT,
    doctor.DOCTOR,
)
