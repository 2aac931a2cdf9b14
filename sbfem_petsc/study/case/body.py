"""Tables of a case file for a body of another code, in the place of geometry, mesh and material."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field

import sbfem_petsc as sb

from ...options import item
from .parts import Law
from .tables import Name, Table, by_kind

Triple = Annotated[list[float], Field(min_length=3, max_length=3)]
Direction = Name | Triple  # a letter is told from others by the body
# Keys that name files, in the order of a reader's arguments.
_FILES = ("file", "stiffness", "mass", "nodes", "unknowns")
_PLACE = "a node set, whose mean is meant, [x, y, z] in m, or the label of a node"


class BodyContact(Table):
    """Contact between two faces, or of one face with a rigid wall."""

    left: Name = item(text="node set of a face")
    right: Name | None = item(None, text="node set of the other face; default: a rigid wall")
    normal: Direction | None = item(
        None, text='"x", "y", "z" or a vector, from left to right; default: that of the left face'
    )
    gap: float | list[float] | None = item(
        None, text="gap, or one for each left node; default: the distance of the nodes, 0 at a wall", unit="m"
    )
    matching: bool = item(True, text="false: the faces' meshes differ")
    law: Law | None = item(None, text="what the faces do to each other, without a layer")
    offset: float = item(0.0, text="from the nodes to the faces, both sides together", unit="m", ge=0)
    interference: bool = item(False, text="true: faces may overlap at rest, as of a press fit")


class BodyPoint(Table):
    """A displacement along one direction: where loads act, and what is seen."""

    at: Name | int | Triple = item(text=_PLACE)
    direction: Direction = item(text='"x", "y", "z" or a vector')
    less: Name | int | Triple | None = item(None, text="place whose displacement is taken off, as `at`")


class _Body(Table):
    contacts: list[BodyContact] = item([], text="what touches, [[body.contacts]]")
    points: Annotated[dict[Name, BodyPoint], Field(min_length=1)] = item(
        text="named displacements, [body.points.NAME]"
    )
    modes: int | None = item(None, text="modes of the reduced model; default: 80", ge=1)

    def _paths(self, resolve: Callable[[str], str]) -> list[str]:
        return [resolve(name) for key, name in self if key in _FILES and name is not None]

    def read(self, resolve: Callable[[str], str]) -> Any:
        """The body."""
        given: Any = self
        return getattr(sb, f"read_{given.kind}")(*self._paths(resolve), units=given.units)

    def files(self, resolve: Callable[[str], str]) -> list[str]:
        """Paths of the files that it is read from, and of decks that its deck includes."""
        from ...bodies.readers import files_of

        return files_of(*self._paths(resolve))


class CalculixBody(_Body):
    """What CalculiX stores of a step *FREQUENCY, SOLVER=MATRIXSTORAGE: deck, .sti, .mas and .dof."""

    kind: Literal["calculix"] = item(text="files of CalculiX")
    file: Name = item(text="path of the deck (.inp), relative to the case file")
    units: Literal["SI", "mm-N-t", "mm-kg-mN"] = item("mm-N-t", text="those of the deck")


class MatricesBody(_Body):
    """Matrix Market, .npz of SciPy, PETSc's binary, or text of Abaqus, with a deck for the nodes."""

    kind: Literal["matrices"] = item(text="files of matrices")
    stiffness: Name = item(text="path, relative to the case file")
    mass: Name = item(text="path")
    nodes: Name = item(text="path of a deck of CalculiX or Abaqus: nodes, sets, supports, elements")
    unknowns: Name | None = item(
        None, text="path of a text of node and direction (0 to 5) of each row; Abaqus' files have them"
    )
    units: Literal["SI", "mm-N-t", "mm-kg-mN"] = item("SI", text="those of the matrices and the deck")


BODIES = (CalculixBody, MatricesBody)
Body = by_kind(*BODIES)
