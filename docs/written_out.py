"""Signatures on the pages of the reference as `help` has them, where mkdocstrings reads the text alone."""

import importlib
import inspect

import griffe


class WrittenOut(griffe.Extension):
    """Pictures' keywords `**look` as title, ax and comm, with what they are where they are left out."""

    def on_function(self, *, func: griffe.Function, **_: object) -> None:
        """In the place of the keywords, as `help` has them."""
        if "look" not in func.parameters:
            return
        function = getattr(importlib.import_module(func.module.path), func.name)
        del func.parameters["look"]
        for name, found in inspect.signature(function).parameters.items():
            if name not in func.parameters:
                kind = griffe.ParameterKind.keyword_only
                func.parameters.add(griffe.Parameter(name, kind=kind, default=repr(found.default)))
