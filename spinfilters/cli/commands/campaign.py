"""The command ``campaign``."""

import argparse

from spinfilters.api.argument_ranges import WORKERS
from spinfilters.cli.command import Command, Subparsers, number


def add_campaign(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters campaign``."""
    campaign = commands.add_parser(
        "campaign",
        help="a table of factors times seeds, run and reported",
        description="Runs every cell of a study with every seed: spinfilters campaign STUDY.toml -o OUT. A finished or interrupted "
        "campaign is reported by: spinfilters campaign report OUT. "
        "One run is made again by: spinfilters campaign repeat OUT RUN.",
    )
    campaign.add_argument("what", metavar="STUDY.toml", help="study file; or report, repeat")
    campaign.add_argument("arguments", metavar="...", nargs="*", help="of report and repeat")
    campaign.add_argument(
        "-o", "--output", metavar="OUT", help="folder of the campaign, or of the repeated run's data set"
    )
    where = campaign.add_mutually_exclusive_group()
    where.add_argument(
        "--workers", type=number(WORKERS), metavar="N", help="processes (default: one per processor)"
    )
    where.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="a Dask scheduler, whose workers make the runs"
    )
    campaign.add_argument("--shard", help=argparse.SUPPRESS)  # refused: a scheduler replaces it
    campaign.add_argument(
        "--resume", action="store_true", help="go on with the rows that OUT has; none is made again"
    )
    return campaign


def run_campaign(options: argparse.Namespace) -> int:
    """Run a study, report it or repeat one of its runs."""
    from spinfilters.cli.campaign_actions import campaign

    return campaign(options)


CAMPAIGN = Command(add_campaign, run_campaign)
