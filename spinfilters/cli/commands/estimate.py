"""The command ``estimate``: one estimator on a recording, as ``compare`` runs several."""

from dataclasses import dataclass, field
from typing import Annotated

from spinfilters.cli.command import Command
from spinfilters.cli.commands.compare import (
    NAMES,
    RECORDING,
    CompareArguments,
    ComparisonArguments,
    compare,
)
from spinfilters.cli.common_options import PrintingOptions
from spinfilters.io.stated_values import Argument, ArgumentGroup


@dataclass(frozen=True, kw_only=True)
class EstimateArguments:
    """Arguments of ``estimate``."""

    dataset: Annotated[str, Argument(RECORDING, positional=True, metavar="DATASET")]
    estimator: Annotated[str, Argument(NAMES, metavar="NAME")] = "ukf"
    how: Annotated[ComparisonArguments, ArgumentGroup()] = field(default_factory=ComparisonArguments)


def estimate(options: EstimateArguments) -> int:
    """Run one estimator, write the run folder and its figures, print the table."""
    return compare(CompareArguments(dataset=options.dataset, estimators=options.estimator, how=options.how))


COMMAND = Command("estimate", EstimateArguments, estimate, common=PrintingOptions)
