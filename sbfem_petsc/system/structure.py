"""The discrete structure: five owners of what is computed with, and the results that are kept of it."""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from meshing.mesh_arrays import ContactPairs, Crack

from ..contact.friction import Memory, refuse_friction
from ..contact.law import ContactLaw
from ..errors import listed
from ..loads import Loads, as_loads
from ..material import AnyMaterial
from ..petsc import PETSc
from ..ranks.parallel import alone, collective
from ..supports import Support
from .contact.rows import Compliance, Contact, contact_of
from .fields.places import Places, Point, places
from .fields.reactions import SupportForces
from .fields.tips import Tips
from .loads import LoadColumns, NodalForces, load_columns
from .matrices import Matrices, matrices
from .solve.equilibrium import Equilibrium, equilibrium
from .solve.static_solver import StaticSolver
from .solve.stiffness import Stiffness

Kept = TypeVar("Kept")


class Structure:
    """A distributed structure of S-elements; `Model` is what a user sees of it.

    Parameters
    ----------
    tips : Tips
        Of the cracks between its S-elements.
    supports : tuple of Support

    Attributes
    ----------
    layout : Layout
        Its places, names and unknowns over the ranks.
    cells : Elements
        Its S-elements with their materials.
    tips : Tips
    statics : Stiffness
        On its supports, with the solver.
    """

    def __init__(self, tips: Tips, supports: tuple[Support, ...]):
        self.tips, self.cells, self.layout, self.supports = tips, tips.elements, tips.layout, supports
        self.comm = self.layout.comm
        # the logarithm's row is one more than the polynomials'
        most = len(self.layout.pairs) + (tips.modes + 1) * len(self.layout.tip_elements)
        self.statics = Stiffness(self.cells, supports, most)
        self._kept: dict[Hashable, Any] = {}

    @functools.cached_property
    def contact(self) -> Contact:
        """Its contact rows. Collective."""
        return contact_of(self.tips)

    # ------------------------------------------------------------------ what users ask for
    @property
    def order(self) -> int:
        """Of the edges' polynomials."""
        return self.layout.order

    @property
    def elements(self) -> int:
        """Number of S-elements."""
        return self.layout.elements

    @property
    def shapes(self) -> int:
        """Number of different shapes among the S-elements."""
        return self.cells.shapes

    @property
    def boundary_unknowns(self) -> int:
        """Displacement unknowns on the boundaries of the S-elements, after the supports."""
        return self.layout.count

    @property
    def unknowns(self) -> int:
        """The same with the auxiliary unknowns of the continued fraction."""
        return self.cells.unknowns

    @property
    def points(self) -> dict[str, tuple[tuple[float, float], tuple[int, int], int]]:
        """Place, m, unknowns and node of each named point."""
        return self.layout.points

    @property
    def cracks(self) -> tuple[Crack, ...]:
        """Cracks and notches, in order."""
        return self.layout.cracks

    @property
    def pairs(self) -> ContactPairs:
        """Pairs of nodes on the faces of cracks."""
        return self.layout.pairs

    @property
    def extent(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and greatest coordinates, m."""
        return self.layout.extent

    @property
    def area(self) -> float:
        """m^2."""
        return self.layout.area

    @property
    def perimeter(self) -> float:
        """m; the faces inside a tip element carry no edges and are not counted."""
        return self.layout.perimeter

    @property
    def materials(self) -> list[AnyMaterial]:
        """By the mesh's names, then those of S-elements in several of them."""
        return self.cells.materials

    @property
    def thickness(self) -> float:
        """m."""
        return self.cells.thickness

    @property
    def continued_fraction(self) -> int:
        """Terms of the continued fraction."""
        return self.cells.terms

    @property
    def contact_laws(self) -> Mapping[str, ContactLaw]:
        """Of the cracks, by name; other laws are of another model, for what is computed is kept."""
        return self.tips.laws

    @property
    def stiffness(self) -> PETSc.Mat:
        """K over the displacement unknowns, N/m. Collective."""
        return self.statics.matrix

    def matrices(self) -> Matrices:
        """K, M and the contact rows as sparse matrices of SciPy, for programs of one's own.

        Raises
        ------
        ValueError
            On several ranks, which hold them in parts.
        """
        return matrices(self.statics, self.contact)

    # ------------------------------------------------------------------ what analyses share
    @property
    def solver(self) -> StaticSolver:
        """Solver of the stiffness (prefix ``static_``). Collective."""
        return self.statics.solver

    @property
    def compliance(self) -> Compliance:
        """Response to unit contact forces, solved for once. Collective."""
        return self.contact.compliance(self.statics, self.tips)

    @functools.cached_property
    def support_forces(self) -> SupportForces:
        """Forces of the supports. Collective."""
        return SupportForces(self.statics)

    def equilibrium(
        self, load: LoadColumns, touching: bool = True, memory: Memory | None = None
    ) -> Equilibrium:
        """Displacements under one column of loads, see `solve.equilibrium`. Collective."""
        return equilibrium(self.statics, self.contact, self.tips, load, touching=touching, memory=memory)

    def load_columns(self, loads: Iterable) -> LoadColumns:
        """What several constant loads do, one column each. Collective.

        Raises
        ------
        KeyError, ValueError, TypeError
            If a point or edge set does not exist or a component is not finite.
        """
        loads = list(loads)
        with collective(self.comm):
            for load in loads:
                self.checked_loads(load)
        return load_columns(self.statics, self.contact, self.tips, loads)

    def checked_loads(self, load: Any, constant: bool = True) -> Loads:
        """The loads, each with an existing place and finite components, or signals unless `constant`."""
        loads = as_loads(load)
        places = NodalForces(self.statics, self.tips)
        for item in loads.parts:
            item.check(places, constant)
        return loads

    def require_support(self, analysis: str) -> None:
        """Raise ValueError, on all ranks, if the supports admit a rigid-body motion."""
        self.statics.require_support(analysis)

    def require_frictionless(self, owner: str, why: str = "knows no friction yet") -> None:
        """Raise ValueError, on all ranks, where faces rub."""
        rubbing = [name for name, law in self.contact_laws.items() if law.rubs]
        if rubbing:
            refuse_friction(owner, f"{listed(rubbing)} has the law {self.contact_laws[rubbing[0]]!r}", why)

    def places(self, points: Sequence[Point], inertia: bool = False, moved: bool = False) -> Places:
        """Forms of displacement and stress at points, with what inertia adds inside S-elements, and what
        supports that move do, if it is asked for. Collective.
        """
        return places(self.tips, points, inertia, moved)

    def nodal(self, owned: np.ndarray, load: LoadColumns | None = None) -> np.ndarray:
        """Displacements (m, 2) of this rank's nodes from its displacement unknowns; 0 where held fixed, or as
        one column of loads moves supports. Collective.
        """
        field = self.layout.nodal(owned)
        return field if load is None or load.lift is None else field + load.lift.nodal[..., 0]

    def keep(self, key: Hashable, make: Callable[[], Kept]) -> Kept:
        """The result of `make()`, made once for a key and kept until `destroy`."""
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def destroy(self) -> None:
        """Free the PETSc objects now instead of at garbage collection, which ranks reach at different
        times.
        """
        if alone(self.comm):
            return
        self._kept.clear()
        self.statics.destroy()
        self.layout.destroy()
