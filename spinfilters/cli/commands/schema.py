"""The command ``schema``: JSON Schema of what users write and what a run writes."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Final, Literal

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
    print(json.dumps(SCHEMAS[options.of](), indent=2))
    return 0


def _settings() -> dict[str, Any]:
    from spinfilters.settings.settings_schema import settings_schema

    return settings_schema()


def _study() -> dict[str, Any]:
    from spinfilters.campaigns.study import study_schema

    return study_schema()


def _summary() -> dict[str, Any]:
    from spinfilters.run.summary_schema import summary_schema

    return summary_schema()


SCHEMAS: Final[dict[str, Callable[[], dict[str, Any]]]] = {
    "settings": _settings,
    "study": _study,
    "summary": _summary,
}
COMMAND = Command(
    "schema",
    SchemaArguments,
    print_schema,
    "Made from the records that validate these files. Editors complete and check TOML and JSON by it.",
)
