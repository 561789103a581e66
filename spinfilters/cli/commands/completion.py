"""The command ``completion``: a script that completes commands, options and choices in a shell, made from the table of commands."""

import shlex
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from spinfilters.cli.command import Command
from spinfilters.cli.commands import COMMANDS
from spinfilters.io.argument_fields import GivenField
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

    print(SHELLS[options.shell](), end="")
    return 0


COMMAND = Command(
    "completion",
    CompletionArguments,
    print_completion,
    'Words are completed after eval "$(spinfilters completion bash)", the same with zsh, or spinfilters completion fish | source. '
    "Put that line into ~/.bashrc or ~/.zshrc, or the script into ~/.config/fish/completions/spinfilters.fish.",
)


@dataclass(frozen=True)
class CompletedCommand:
    """What can stand after the words of a command.

    Attributes
    ----------
    words : str
        That call it, such as ``campaign report``.
    help : str
        Its one line.
    options : tuple[GivenField, ...]
        Its options, those given by their place left out.
    choices : tuple[object, ...]
        Of the first argument given by its place, where that has a list of values.
    """

    words: str
    help: str
    options: tuple[GivenField, ...]
    choices: tuple[object, ...] = ()


def completed_commands() -> Iterator[CompletedCommand]:
    """Every command and every action of a group, in the order of the table."""
    for listed in COMMANDS:
        for words, command in listed.load().parts:
            fields = command.fields
            options = tuple(each for each in fields if not each.argument.positional)
            choices = next((each.choices for each in fields if each.argument.positional), None)
            yield CompletedCommand(words, command.help or listed.help, options, choices or ())


def flags_of(field: GivenField) -> tuple[str, ...]:
    """Short and long flag of an option."""
    return (field.argument.short, field.flag) if field.argument.short else (field.flag,)


def _choices(field: GivenField) -> str:
    return " ".join(map(str, field.choices or ()))


COMMON: Final = ("-h", "--help", "-v", "--verbose")
"""Options of every command."""
_BASH: Final = """# Completion of spinfilters for bash: eval "$(spinfilters completion bash)"
_spinfilters() {{
  local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD-1]}} command=${{COMP_WORDS[1]}} found=""
  COMPREPLY=()
  if [ "$COMP_CWORD" = 1 ]; then
    found={names}
  else
    case "$command:$before" in
{choices}
    esac
    if [ -z "$found" ]; then
      case "$command" in
{options}
      esac
      case "$word" in -*) ;; *) if [ "$COMP_CWORD" = 2 ]; then case "$command" in
{first}
      esac; else found=""; fi ;; esac
    fi
  fi
  if [ -n "$found" ]; then COMPREPLY=($(compgen -W "$found" -- "$word")); fi
}}
complete -o default -o bashdefault -F _spinfilters spinfilters
"""


def bash_script() -> str:
    """Completion for bash: of commands, options, and the choices of an option; file names elsewhere."""
    commands = list(completed_commands())
    groups: dict[str, list[CompletedCommand]] = {}
    for each in commands:
        groups.setdefault(each.words.split()[0], []).append(each)
    choices, options, first = [], [], []
    for name, members in groups.items():
        flags = list(dict.fromkeys([f for m in members for o in m.options for f in flags_of(o)] + [*COMMON]))
        options.append(f"        {name}) found={shlex.quote(' '.join(flags))} ;;")
        inner = [m.words.split()[1] for m in members if " " in m.words]
        inner += [str(choice) for m in members for choice in m.choices]
        first += [f"        {name}) found={shlex.quote(' '.join(inner))} ;;"] if inner else []
        for option in {o.flag: o for m in members for o in m.options if o.choices}.values():
            pattern = "|".join(f"{name}:{flag}" for flag in flags_of(option))
            choices.append(f"      {pattern}) found={shlex.quote(_choices(option))} ;;")
    return _BASH.format(
        names=shlex.quote(" ".join(groups)),
        choices="\n".join(choices),
        options="\n".join(options),
        first="\n".join(first),
    )


def zsh_script() -> str:
    """Completion for zsh: the script of bash through zsh's own adapter, with commands described."""
    described = "\n".join(f"    {shlex.quote(f'{listed.name}:{listed.help}')}" for listed in COMMANDS)
    return f"""# Completion of spinfilters for zsh: eval "$(spinfilters completion zsh)"
autoload -Uz compinit bashcompinit && {{ [ -n "$_comps" ] || compinit -u; }} && bashcompinit
{bash_script()}
_spinfilters_commands() {{
  local -a commands=(
{described}
  )
  if (( CURRENT == 2 )); then _describe command commands; else _bash_complete -o default -o bashdefault -F _spinfilters; fi
}}
compdef _spinfilters_commands spinfilters
"""


def fish_script() -> str:
    """Completion for fish: commands with their help, options with theirs, and choices."""
    lines = ["# Completion of spinfilters for fish: spinfilters completion fish | source"]
    for listed in COMMANDS:
        lines.append(
            f"complete -c spinfilters -n __fish_use_subcommand -a {listed.name} -d {shlex.quote(listed.help)}"
        )
    for each in completed_commands():
        name, *action = each.words.split()
        seen = f"__fish_seen_subcommand_from {name}"
        for word in (*action, *each.choices):
            lines.append(
                f"complete -c spinfilters -n {shlex.quote(seen)} -a {word} -d {shlex.quote(each.help)}"
            )
        for option in each.options:
            short = f" -s {option.argument.short.lstrip('-')}" if option.argument.short else ""
            value = "" if option.kind is bool else " -r"
            value = f" -x -a {shlex.quote(_choices(option))}" if option.choices else value
            lines.append(
                f"complete -c spinfilters -n {shlex.quote(seen)}{short} -l {option.flag.lstrip('-')}{value} "
                f"-d {shlex.quote(option.argument.help)}"
            )
    return "\n".join(lines) + "\n"


SHELLS: Final[dict[str, Callable[[], str]]] = {
    "bash": bash_script,
    "zsh": zsh_script,
    "fish": fish_script,
}
