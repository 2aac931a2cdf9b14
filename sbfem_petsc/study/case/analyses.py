"""The kinds of analysis that a case may ask for: those of the files in `study/kinds/`."""

from __future__ import annotations

import importlib
import pkgutil
from typing import TYPE_CHECKING

from .. import kinds
from ..kinds.kind import Kind
from .tables import by_kind, kind_name

_MODULES = [
    importlib.import_module(f"{kinds.__name__}.{m.name}") for m in pkgutil.iter_modules(kinds.__path__)
]
# Kinds by name, of all modules in the folder.
KINDS: dict[str, type[Kind]] = {
    kind_name(own): own
    for module in _MODULES
    for own in vars(module).values()
    if isinstance(own, type) and issubclass(own, Kind) and "kind" in own.model_fields
}


def kind_called(name: str) -> type[Kind]:
    """The kind of a name; of one that a file may bear and nobody knows, what all have in common."""
    return KINDS.get(name, Kind)


if TYPE_CHECKING:
    Analysis = Kind
else:
    Analysis = by_kind(*KINDS.values())
