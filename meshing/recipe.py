"""How a mesh was made, so that the same structure can be meshed finer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, eq=False)
class Recipe:
    """A function that meshes and the options it was called with.

    Attributes
    ----------
    make : callable
        ``make(**options)`` gives the mesh: `Beam.mesh`, `Plate.mesh`, `read_gmsh` of a path.
    options : mapping
        None stands for a default.
    """

    make: Callable[..., Any]
    options: Mapping[str, Any]

    @property
    def chosen(self) -> dict[str, Any]:
        """The options that were given."""
        return {name: value for name, value in self.options.items() if value is not None}

    def remade(self, changes: Mapping[str, Any]) -> Any:
        """The mesh made with some options changed."""
        return self.make(**{**self.options, **changes})
