"""Arguments of ``live``, whose defaults the options of a live run take. Nothing heavy is imported here, so that help is quick."""

from dataclasses import dataclass, field
from typing import Annotated, Literal

from spinfilters.io.stated_values import Argument, ArgumentGroup, NumberRange
from spinfilters.settings.settings_arguments import SettingsArguments


@dataclass(frozen=True, kw_only=True)
class LiveArguments:
    """Arguments of ``live``."""

    dataset: Annotated[
        str, Argument("a recording, as compare takes it; no images", positional=True, metavar="DATASET")
    ]
    input: Annotated[
        str | None,
        Argument(
            "- (standard input), tcp:HOST:PORT, unix:PATH, a named pipe or a growing file", metavar="PLACE"
        ),
    ] = None
    speed: Annotated[float, NumberRange(1e-3, 1e6), Argument("speed of the replay, 1 is real time")] = 1.0
    filter: Annotated[
        Literal["mekf", "ukf", "embedded", "embedded-double"], Argument("filter that answers")
    ] = "mekf"
    no_smoother: Annotated[bool, Argument("the filter alone")] = False
    patience: Annotated[
        float,
        NumberRange(0.05, 1e4, "s"),
        Argument("silence of the smoother after which it is restarted", metavar="SECONDS"),
    ] = 5.0
    smoother_memory: Annotated[
        float | None,
        NumberRange(64, 1e7, "MiB"),
        Argument("address space of the smoother's process (default: no limit)", metavar="MIB"),
    ] = None
    format: Annotated[Literal["lines", "tum"], Argument("JSON lines or TUM")] = "lines"
    predict: Annotated[
        float, NumberRange(0, 1e4, "s"), Argument("also predict every answer so far ahead", metavar="SECONDS")
    ] = 0.0
    deadline_ms: Annotated[
        float, NumberRange(1e-3, 1e6, "ms"), Argument("time from an epoch's arrival to its answer, ms")
    ] = 20.0
    stated: Annotated[SettingsArguments, ArgumentGroup()] = field(default_factory=SettingsArguments)
    summary: Annotated[str | None, Argument("also write the counts as JSON", metavar="FILE")] = None
    view: Annotated[bool, Argument("show a table in the terminal")] = False
