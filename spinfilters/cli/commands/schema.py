"""The command ``schema``: JSON Schema of what users write and what a run writes."""

import json
from dataclasses import dataclass
from typing import Annotated, Literal

from spinfilters.cli.command import Command
from spinfilters.io.stated_values import Argument


@dataclass(frozen=True, kw_only=True)
class SchemaArguments:
    """Arguments of ``schema``."""

    of: Annotated[
        Literal["settings", "study", "summary"],
        Argument(
            "settings and study are TOML files of yours, summary is summary.json of a run",
            positional=True,
            metavar="OF",
        ),
    ]


def print_schema(options: SchemaArguments) -> int:
    """Print the schema as JSON."""
    if options.of == "settings":
        from spinfilters.settings.settings_schema import settings_schema as schema
    elif options.of == "study":
        from spinfilters.campaigns.study import study_schema as schema
    else:
        from spinfilters.run.summary_schema import summary_schema as schema

    print(json.dumps(schema(), indent=2))
    return 0


COMMAND = Command(
    "schema",
    SchemaArguments,
    print_schema,
    "Made from the records that validate these files. Editors complete and check TOML and JSON by it.",
)
