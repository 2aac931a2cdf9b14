"""Notches and holes as a person describes them, validated; SI units, angles in degrees."""

from __future__ import annotations

import math
from dataclasses import dataclass

from meshing.input_checks import number, positive

_STEEPEST = 85.0  # degrees between a face and the vertical


@dataclass(frozen=True)
class VNotch:
    """A V-notch or crack that runs from a tip in the beam to its top edge.

    Attributes
    ----------
    x : float
        Position of the tip along the beam, m.
    depth : float
        Vertical distance of the tip from the top edge, m.
    opening : float
        Total angle between the faces, degrees; 0 is a closed crack.
    tilt : float
        Angle of the axis from the vertical, degrees, positive with the mouth towards the free end (+x).
    """

    x: float
    depth: float
    opening: float
    tilt: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", number("VNotch", "x", self.x))
        object.__setattr__(self, "depth", positive("VNotch", "depth", self.depth))
        object.__setattr__(self, "opening", number("VNotch", "opening", self.opening))
        object.__setattr__(self, "tilt", number("VNotch", "tilt", self.tilt))
        if self.opening < 0:
            raise ValueError(
                f"VNotch: opening is {self.opening:g} degrees, it must be 0 (closed crack) or positive."
            )
        if abs(self.tilt) + self.opening / 2 > _STEEPEST:
            raise ValueError(
                f"VNotch: with opening {self.opening:g} and tilt {self.tilt:g} degrees a face leans "
                f"{abs(self.tilt) + self.opening / 2:g} degrees "
                f"from the vertical; |tilt| + opening / 2 must be at most {_STEEPEST:g} for the faces to "
                "reach the top edge."
            )

    def __repr__(self) -> str:
        return (
            f"VNotch(x={self.x:g} m, depth={self.depth:g} m, opening={self.opening:g} deg, "
            f"tilt={self.tilt:g} deg)"
        )

    @property
    def right_offset(self) -> float:
        """x of the mouth corner at the free-end side minus x of the tip, m."""
        return self.depth * math.tan(math.radians(self.tilt + self.opening / 2))

    @property
    def left_offset(self) -> float:
        """x of the mouth corner at the clamp side minus x of the tip, m."""
        return self.depth * math.tan(math.radians(self.tilt - self.opening / 2))

    @property
    def axis(self) -> tuple[float, float]:
        """Unit vector from the tip along the axis to the mouth."""
        return math.sin(math.radians(self.tilt)), math.cos(math.radians(self.tilt))

    @property
    def length(self) -> float:
        """Distance from the tip to the mouth along the axis, m."""
        return self.depth / math.cos(math.radians(self.tilt))


@dataclass(frozen=True)
class Hole:
    """A circular hole.

    Attributes
    ----------
    x, y : float
        Centre, m; y from the lower edge.
    diameter : float
        m.
    """

    x: float
    y: float
    diameter: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "x", number("Hole", "x", self.x))
        object.__setattr__(self, "y", number("Hole", "y", self.y))
        object.__setattr__(self, "diameter", positive("Hole", "diameter", self.diameter))

    def __repr__(self) -> str:
        return f"Hole(x={self.x:g} m, y={self.y:g} m, diameter={self.diameter:g} m)"

    @property
    def radius(self) -> float:
        """m."""
        return self.diameter / 2
