"""A command of ``spinfilters``, and the table of them."""

import argparse
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

Subparsers = Any
"""What `argparse.ArgumentParser.add_subparsers` returns; its class is private."""


@dataclass(frozen=True)
class Command:
    """A command: its place in the help, its parser and the function that runs it.

    ``run`` is ``module:function``, imported when the command is chosen; the function takes the parsed arguments and returns the
    exit code.
    """

    place: int
    add_parser: Callable[[Subparsers], argparse.ArgumentParser]
    run: str

    def add(self, subparsers: Subparsers) -> None:
        """Register the command's parser, with what runs it."""
        self.add_parser(subparsers).set_defaults(command=self)

    def __call__(self, options: argparse.Namespace) -> int:
        module, function = self.run.split(":")
        return getattr(import_module(module), function)(options)


def commands() -> list[Command]:
    """Every command of the folder ``commands``, in the order of the help."""
    package = import_module("spinfilters.cli.commands")
    modules = [
        import_module(f"{package.__name__}.{found.name}") for found in pkgutil.iter_modules(package.__path__)
    ]
    return sorted((command for module in modules for command in module.COMMANDS), key=lambda each: each.place)
