"""The kinds of analysis that a case may ask for: those of the files in `study/kinds/`."""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

from .. import kinds
from ..kinds.kind import Kind
from .tables import by_kind, kind_name


def _found() -> dict[str, type[Kind]]:
    """Kinds by name, of all modules in the folder."""
    for module in pkgutil.iter_modules(kinds.__path__):
        importlib.import_module(f"{kinds.__name__}.{module.name}")
    todo, found = [Kind], {}
    while todo:
        kind = todo.pop()
        todo += kind.__subclasses__()
        if "kind" in kind.model_fields:
            found[kind_name(kind)] = kind
    return dict(sorted(found.items()))


KINDS = _found()


def kind_called(name: str) -> type[Kind]:
    """The kind of a name; of one that a file may bear and nobody knows, what all have in common."""
    return KINDS.get(name, Kind)


if TYPE_CHECKING:
    Analysis = Kind
else:
    Analysis = by_kind(*KINDS.values())
