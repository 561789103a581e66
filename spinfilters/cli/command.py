"""A command of ``spinfilters``: its parser, and the function that runs it."""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

Subparsers = Any
"""What `argparse.ArgumentParser.add_subparsers` returns; its class is private."""


@dataclass(frozen=True)
class Command:
    """A command: its parser and the function that runs it.

    ``run`` takes the parsed arguments and returns the exit code. It imports what it needs when it is called, so that help is quick.
    """

    add_parser: Callable[[Subparsers], argparse.ArgumentParser]
    run: Callable[[argparse.Namespace], int]

    def add(self, subparsers: Subparsers) -> None:
        """Register the command's parser, with what runs it."""
        self.add_parser(subparsers).set_defaults(command=self.run)
