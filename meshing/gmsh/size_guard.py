"""How many cells and unknowns a mesh would have, estimated before it is made."""

from __future__ import annotations

import math
from collections.abc import Sequence

from meshing.gmsh.confined import Refusal
from meshing.gmsh.model import FileModel

_TRIANGLES = 4 / math.sqrt(3)  # equilateral triangles of side 1 in an area of 1


class Guard:
    """Refuses meshes that are too large.

    Parameters
    ----------
    order : int
        Order of the S-elements' edges.
    most_unknowns : int
    """

    def __init__(self, order: int, most_unknowns: int) -> None:
        self._order, self._most = order, most_unknowns
        # A mesh of n triangles has about n / 2 vertices and 3 n / 2 edges, and two unknowns a node.
        self._a_triangle = 3 * order - 2

    def check_area(self, area: float, size: float | None, largest: float | None) -> None:
        """The cells of side `size`, or of the largest side the file allows, in `area`."""
        side = size if size is not None else largest
        if side is None or not area > 0:
            return
        cells = _TRIANGLES * area / side**2
        fits = math.sqrt(_TRIANGLES * area * self._a_triangle / self._most)
        given = "size" if size is not None else "Mesh.MeshSizeMax"
        self._check(
            f"{given} = {side:g} would make about {cells:.2g} cells",
            cells * self._a_triangle,
            f"from {given} = {fits:.2g} on (in the file's unit) it fits",
        )

    def check_curve(self, curve: int, length: float, sizes: Sequence[float], largest: float) -> None:
        """The edges on a curve with the given sizes at its ends."""
        ends = [min(size, largest) for size in (*sizes, largest)[:2]]
        if not length > 0 or min(ends) > length:
            return
        low, high = min(ends), min(max(ends), length)
        edges = length / low if high <= low * 1.001 else length * math.log(high / low) / (high - low)
        what = f"the sizes at the ends of curve {curve} ({low:g}) would make about {edges:.2g} edges there"
        self._check(what, edges * self._a_triangle, "give larger ones")

    def check_lines(self, edges: int) -> None:
        """The edges on all curves, each of which has a cell."""
        self._check(f"its curves have {edges} edges", edges * self._a_triangle, "give larger sizes")

    def check_cells(self, model: FileModel) -> None:
        """The mesh as it is."""
        cells = [(len(block.nodes), block.corners) for block in model.blocks if block.dimension == 2]
        unknowns = sum(count * (corners * self._order - 2) for count, corners in cells)
        self._check(f"it has {sum(count for count, _ in cells)} cells", unknowns, "mesh it more coarsely")

    def _check(self, what: str, unknowns: float, mend: str) -> None:
        if unknowns > self._most:
            raise Refusal(
                f"{what}, about {unknowns:.2g} unknowns at order {self._order}, more than max_unknowns = "
                f"{self._most}; {mend}, or take a lower order or a larger max_unknowns."
            )
