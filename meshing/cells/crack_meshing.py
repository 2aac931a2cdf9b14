"""How cracks are meshed: the user's choices."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from meshing.input_checks import flag, integer, length, number


@dataclass(frozen=True)
class CrackMeshing:
    """How cracks are meshed.

    Attributes
    ----------
    tip_element : bool
        Rings around each tip with an open cell in their middle.
    tip_size : float or None
        Half-size of that cell, m; None: 0.02 of the crack's length, or
        0.03 of the reach of the cells around the tip if that is less.
    grading : float
        Largest ratio of neighbouring rings.
    face_size : float or None
        Longest edge on the faces, m; None: `face_edges` of them along the crack.
    face_edges : int
    sectors : bool
        No rings around tips but closed cells that meet in the tip.
    """

    tip_element: bool = True
    tip_size: float | None = None
    grading: float = 2.5
    face_size: float | None = None
    face_edges: int = 12
    sectors: bool = False

    @classmethod
    def checked(cls, extent: float, given: Mapping[str, Any], sectors: bool = False) -> CrackMeshing:
        """What is given of it among the arguments of a function that meshes, checked.

        Parameters
        ----------
        extent : float
            The body's size, m; 0 where it is not known yet.
        given : mapping of str to object
            Arguments by their names.
        """
        sizes: dict[str, float | None] = {"tip_size": None, "face_size": None}
        for name, least in (("tip_size", 1e-7), ("face_size", 1e-6)):
            if given.get(name) is not None:
                sizes[name] = size = length("mesh", name, given[name])
                if size < least * extent:
                    raise ValueError(
                        f"mesh: {name} {size:g} m is below {least:g} of the body's size {extent:g} m, "
                        "round-off would show; make it larger."
                    )
        grading = number("mesh", "grading", given["grading"])
        if not 1.1 <= grading <= 10:
            raise ValueError(f"mesh: grading is {grading:g}, a ratio from 1.1 to 10 was expected.")
        return cls(
            flag("mesh", "tip_element", given.get("tip_element", True)),
            sizes["tip_size"],
            grading,
            sizes["face_size"],
            face_edges=integer("mesh", "face_edges", given.get("face_edges", 12), least=1, most=1000),
            sectors=sectors,
        )
