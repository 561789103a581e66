"""The command ``completion``: a script that completes words of ``spinfilters`` in a shell."""

from dataclasses import dataclass
from typing import Annotated, Literal

from spinfilters.cli.command import Command
from spinfilters.io.stated_values import Argument


@dataclass(frozen=True, kw_only=True)
class CompletionArguments:
    """Arguments of ``completion``."""

    shell: Annotated[
        Literal["bash", "zsh", "fish"],
        Argument("shell that the script is for", positional=True, metavar="SHELL"),
    ]


def print_completion(options: CompletionArguments) -> int:
    """Print the script."""
    from spinfilters.cli.shell_scripts import SHELLS

    print(SHELLS[options.shell](), end="")
    return 0


COMMAND = Command(
    "completion",
    CompletionArguments,
    print_completion,
    'Words are completed after eval "$(spinfilters completion bash)", the same with zsh, or spinfilters completion fish | source. '
    "Put that line into ~/.bashrc or ~/.zshrc, or the script into ~/.config/fish/completions/spinfilters.fish.",
)
