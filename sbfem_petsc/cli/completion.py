"""Completion of the words of `sbfem` in bash and zsh."""

from __future__ import annotations

import argparse

from ..study.starter import KINDS

# Files are the shell's own; zsh reads bash's functions once it is told to.
_SCRIPT = """\
if [ -n "$ZSH_VERSION" ]; then autoload -U +X bashcompinit && bashcompinit; fi
_sbfem() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        words="{commands}"
    elif [[ "$word" == -* ]]; then
        case "${{COMP_WORDS[1]}}" in
{options}
        esac
    elif [ "${{COMP_WORDS[1]}}" = new ] && [ "$COMP_CWORD" -eq 2 ]; then
        words="{kinds}"
    fi
    COMPREPLY=($(compgen -W "$words" -- "$word"))
}}
complete -o default -F _sbfem sbfem
"""


def script(parser: argparse.ArgumentParser) -> str:
    """What a shell evaluates to complete the commands of a parser, their options and the kinds of cases."""
    (commands,) = (a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    options = {
        name: " ".join(text for action in made._actions for text in action.option_strings if text[1] == "-")
        for name, made in commands.items()
    }
    return _SCRIPT.format(
        commands=" ".join([*commands, "--help", "--version"]),
        options="\n".join(f'            {name}) words="{found}" ;;' for name, found in options.items()),
        kinds=" ".join(KINDS),
    )
