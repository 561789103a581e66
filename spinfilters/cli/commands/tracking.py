"""The command ``track``."""

import argparse

from spinfilters.cli.command import Command, Subparsers


def add_track(commands: Subparsers) -> argparse.ArgumentParser:
    """Parser of ``spinfilters track``."""
    track = commands.add_parser(
        "track",
        help="stereo images to tracks of landmarks",
        description="Reads stereo images in the EuRoC layout (cam0/data, cam0/data.csv, cam0/sensor.yaml; cam1), finds "
        "landmarks and follows them through all revolutions. The result is a data set of stereo tracks with a covariance per row, "
        "for compare; front_end.json says what was lost at which stage, and why. compare takes the images themselves too.",
    )
    track.add_argument("dataset", metavar="DATASET", help="folder of the images")
    track.add_argument(
        "-o", "--output", metavar="TRACKS", required=True, help="folder of the data set of tracks"
    )
    track.add_argument(
        "--detector", default="sift", help="sift (default) or orb, which is faster and less exact"
    )
    track.add_argument(
        "--online",
        action="store_true",
        help="without looking ahead, as on a spacecraft: images in, observations out",
    )
    return track


COMMANDS = (Command(28, add_track, "spinfilters.cli.track:track"),)
"""``spinfilters track``."""
