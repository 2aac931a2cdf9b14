"""Completion of the words of `sbfem` in bash and zsh."""

from __future__ import annotations

import argparse
from importlib import resources

from ..study.starter import KINDS


def script(parser: argparse.ArgumentParser) -> str:
    """What a shell evaluates to complete the commands of a parser, their options and the kinds of cases."""
    (commands,) = (a.choices for a in parser._actions if isinstance(a, argparse._SubParsersAction))
    options = {
        name: " ".join(text for action in made._actions for text in action.option_strings if text[1] == "-")
        for name, made in commands.items()
    }
    text = (resources.files(__package__) / "completion.sh").read_text()
    return text.format(
        commands=" ".join([*commands, "--help", "--version"]),
        options="\n".join(f'            {name}) words="{found}" ;;' for name, found in options.items()),
        kinds=" ".join(KINDS),
    )
