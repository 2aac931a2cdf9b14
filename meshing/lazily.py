"""Public names of a package, loaded when they are first asked for."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any


def loaded(
    package: str, names: Mapping[str, Sequence[str]]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """`__getattr__` and `__dir__` of a package, from its names by the modules of it or of `meshing` in which
    they stand.
    """
    face, home = vars(sys.modules[package]), {name: place for place, own in names.items() for name in own}

    def value(name: str) -> Any:
        if name not in home:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        place = home[name] if home[name].startswith("meshing.") else f"{package}.{home[name]}"
        face[name] = found = getattr(importlib.import_module(place), name)
        return found

    return value, lambda: sorted(face["__all__"])
