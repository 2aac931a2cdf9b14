"""A structure with its material, supports and damping, as a user describes it; keeps what analyses share."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from meshing.boundary_mesh import BoundaryMesh

from ..checks import instance, integer, positive, shown
from ..contact.law import ContactLaw, Unilateral, check_law
from ..damping import (
    DampingTable,
    checked_damping,
    checked_rayleigh,
    in_words,
    modal_ratios,
    ratios_by_frequency,
    rayleigh_ratios,
)
from ..errors import UnknownName, listed, wrong_input
from ..material import AnyMaterial, Material, OrthotropicMaterial, SectorMaterials
from ..petsc import MPI, collect
from ..ranks.parallel import agreed, checked_communicator, collective
from ..supports import as_supports
from .body import Body
from .elements.elements import Elements
from .elements.plausibility import warn_of_wave_speeds
from .fields.tips import Tips
from .layout.distribution import declared_clamp, distribute
from .solve.modal_result import Modal
from .solve.modes import lowest_modes, modes_below
from .solve.pencil import Pencil
from .structure import Structure

# Stands for "what the mesh declares".
_DECLARED = object()
# Of the models made on rank 0 of any communicator.
_NUMBERS = itertools.count()


class Model(Structure):
    """A structure of S-elements with its material, supports and damping.

    A context manager: at the end of a ``with`` block its PETSc objects are freed, as by `destroy`.

    Parameters
    ----------
    mesh : BoundaryMesh
        On every rank, or on rank 0 alone (None elsewhere): each rank then receives its part.
    material : Material, OrthotropicMaterial or dict of str to these
        One for all, or one for each of the mesh's material names.
    clamped : str, sequence of str or None
        Edge sets or points held fixed in both directions; None for none of them. Default: the edge set that
        the mesh declares, "left" of a beam; other meshes declare none.
    continued_fraction : int
        Terms of the continued fraction for the inertia of each S-element (Mcf of the paper); 0: mass matrix
        alone.
    damping : float, sequence of float or DampingTable
        Modal damping ratio of every dynamic analysis: of all modes, of each of the lowest modes in ascending
        order, the last one holding for all further modes, or by frequency. An unreduced model meets it in its
        computed modes, and has none beyond them.
    rayleigh : (float, float)
        a (1/s) and b (s) of a damping matrix a M + b K, which adds a / (2 omega) + b omega / 2 to the ratio
        of a mode; see `rayleigh_factors`.
    contact_laws : ContactLaw or dict of str to ContactLaw, optional
        One for all cracks, or by the names of cracks, such as ``{"crack2": Tied()}``: `Unilateral`, `Tied`
        or `Clearance`. Default, and of cracks that are not named: `Unilateral`.
    thickness : float
        m.
    supports : sequence of Support
        Further supports: single directions, elastic supports.
    tip_modes : int
        Polynomials of the contact pressure on the faces inside each tip element, which carry no nodes; where
        faces that stand apart may close up to the tip a logarithm acts beside them. 0: no contact there.
    comm : mpi4py communicator, optional
        Default: MPI.COMM_WORLD.

    Attributes
    ----------
    boundary_unknowns : int
        Displacement unknowns on the boundaries of the S-elements, after the supports.
    unknowns : int
        The same with the auxiliary unknowns of the continued fraction.
    elements, shapes : int
        Number of S-elements and of different shapes among them.
    area, perimeter : float
        m^2, m; the faces inside a tip element carry no edges and are not counted.

    Raises
    ------
    ValueError, TypeError, KeyError
        One sentence that names the item, on all ranks.

    Warns
    -----
    UnitWarning
        Of a material in which waves are slower than 50 or faster than 20,000 m/s.
    """

    @agreed("mesh")
    def __init__(
        self,
        mesh: BoundaryMesh | None,
        material: Material | OrthotropicMaterial | Mapping[str, Material | OrthotropicMaterial],
        clamped: Any = _DECLARED,
        continued_fraction: int = 1,
        *,
        damping: float | Sequence[float] | np.ndarray | DampingTable = 0.0,
        thickness: float = 1.0,
        supports: Any = (),
        comm: MPI.Comm | None = None,
        rayleigh: tuple[float, float] = (0.0, 0.0),
        tip_modes: int = 4,
        contact_laws: ContactLaw | Mapping[str, ContactLaw] | None = None,
    ):
        comm = checked_communicator("Model", comm)
        with collective(comm):
            terms = integer("Model", "continued_fraction", continued_fraction, least=0, most=20)
            self.damping = checked_damping("Model", damping)
            self.rayleigh = checked_rayleigh("Model", rayleigh)
            thickness = positive("Model", "thickness", thickness, "m")
            tip_modes = integer("Model", "tip_modes", tip_modes, least=0, most=12)
            further = as_supports(None if clamped is _DECLARED else clamped, supports)
        collect(comm)  # models before this one that nobody has freed
        self._recipe = getattr(mesh, "recipe", None)
        self._given = dict(
            material=material,
            clamped=clamped,
            damping=damping,
            thickness=thickness,
            supports=supports,
            comm=comm,
            rayleigh=rayleigh,
            contact_laws=contact_laws,
        )
        held = further if clamped is not _DECLARED else as_supports(declared_clamp(comm, mesh), ()) + further
        layout = distribute(comm, mesh, held)
        with collective(comm):
            materials = _materials(material, layout.material_names)
            sectors = [_around(tuple(materials[k] for k in parts)) for parts in layout.compositions]
            laws = _contact_laws(contact_laws, tuple(crack.name for crack in layout.cracks))
            if layout.count == 0:
                raise ValueError(
                    f"Model: the supports ({listed(s.where for s in held)}) leave no free displacement"
                )
        elements = Elements(layout, [*materials, *sectors], thickness, terms)
        super().__init__(Tips(elements, MappingProxyType(laws), tip_modes), held)
        self._number = comm.bcast(next(_NUMBERS))
        warn_of_wave_speeds(elements)
        self._modes: Modal | None = None
        self._pencil: Pencil | None = None

    def _fingerprint(self) -> object:
        """What tells it from others, the same on all ranks."""
        return self._number

    def __enter__(self) -> Model:
        return self

    def __exit__(self, *_: object) -> None:
        self.destroy()

    # ------------------------------------------------------------------ what analyses share
    @agreed()
    def modes(self, count: int) -> Modal:
        """The lowest modes by the defaults of `modal`, computed once for the largest count asked for.
        Collective.
        """
        count = integer("Model.modes", "count", count, least=0, most=self.boundary_unknowns // 2)
        if self._modes is None or len(self._modes.frequencies) < count:
            # none are taken from one
            self._modes = lowest_modes(self, max(count, 1), kept=counted_pencil(self, count))
        return self._modes.selected(np.arange(count))

    def mesh_options(self, owner: str) -> dict[str, Any]:
        """Options that the mesh was made with, those left to their defaults not among them. Collective.

        Raises
        ------
        ValueError
            If it is not known how the mesh was made; on all ranks.
        """
        chosen = self.comm.allgather(None if self._recipe is None else self._recipe.chosen)
        known = [options for options in chosen if options is not None]
        if not known:
            raise wrong_input(
                f"{owner}: it is not known how the model's mesh was made, so it cannot be made finer; "
                "take it from .mesh() or read_gmsh, or give estimate a function that makes the model"
            )
        return known[0]

    def remade(
        self, mesh: Mapping[str, Any], *, continued_fraction: int | None = None, tip_modes: int | None = None
    ) -> Model:
        """The same structure on another mesh. Collective.

        Parameters
        ----------
        mesh : mapping
            Options of `Beam.mesh`, `Plate.mesh` or `read_gmsh` that are to change.
        continued_fraction, tip_modes : int, optional
            Default: as they are.

        Raises
        ------
        ValueError
            If it is not known how the mesh was made, or it cannot be made so.
        """
        self.mesh_options("remade")
        made = None
        with collective(self.comm):
            if self._recipe is not None:
                made = self._recipe.remade(mesh)
        return Model(
            made,
            continued_fraction=self.continued_fraction if continued_fraction is None else continued_fraction,
            tip_modes=self.tips.modes if tip_modes is None else tip_modes,
            **self._given,
        )

    def damping_ratios(self, omega: np.ndarray) -> np.ndarray:
        """Damping ratios of the lowest modes by their angular frequencies `omega` (rad/s): the modal ratios
        and Rayleigh's a / (2 omega) + b omega / 2.
        """
        return modal_ratios(self.damping, omega) + rayleigh_ratios(self.rayleigh, omega)

    def record(self) -> Body | None:
        """Inputs and mesh, for a file beside results; on rank 0, None elsewhere. Collective."""
        return Body.of(self, ratios_by_frequency(self.damping), self.rayleigh)

    def __repr__(self) -> str:
        return (
            f"Model({self.elements} S-elements of {self.shapes} shapes, order {self.order}, "
            f"{self.boundary_unknowns} boundary unknowns, "
            f"{self.unknowns} unknowns with continued_fraction={self.continued_fraction}, {len(self.pairs)} "
            f"contact pairs, {in_words(self.damping, self.rayleigh)}, "
            f"{self.comm.size} rank{'s' if self.comm.size > 1 else ''})"
        )


def _around(parts: tuple[Material | OrthotropicMaterial, ...]) -> AnyMaterial:
    """The material of an S-element from that of each edge's sector: materials of two names may be one."""
    return SectorMaterials(parts) if len(set(parts)) > 1 else parts[0]


def _materials(material: object, names: tuple[str, ...]) -> list[Material | OrthotropicMaterial]:
    """One material per name of the mesh."""
    kinds = (Material, OrthotropicMaterial)
    if isinstance(material, kinds):
        return [material] * len(names)
    if not isinstance(material, dict):
        raise TypeError(
            f"Model: material = {shown(material)} must be a Material or a dict of material names to Materials"
        )
    missing = [n for n in names if n not in material]
    if missing:
        raise UnknownName(f"Model: no material is given for {listed(missing)}; the mesh has {listed(names)}")
    for name in names:
        instance("Model", f"material[{name!r}]", material[name], kinds, "a Material")
    return [material[n] for n in names]


def _contact_laws(laws: object, cracks: tuple[str, ...]) -> dict[str, ContactLaw]:
    """The contact law of each crack."""
    if laws is None or isinstance(laws, ContactLaw):
        law = Unilateral() if laws is None else laws
        check_law("Model", "contact_laws", law)
        return {name: law for name in cracks}
    if not isinstance(laws, Mapping):
        raise TypeError(
            f"Model: contact_laws = {shown(laws)} must be a contact law or a dict of crack names to contact "
            f"laws, {{'crack1': Tied()}}"
        )
    for name, law in laws.items():
        if name not in cracks:
            raise UnknownName(
                f"Model: contact_laws names {name!r}, which is no crack of the mesh; it has {listed(cracks)}"
            )
        check_law("Model", f"contact_laws[{name!r}]", law)
    return {name: laws.get(name, Unilateral()) for name in cracks}


def has_modes(model: Model) -> bool:
    """Whether modes are computed."""
    return model._modes is not None


def counted_pencil(model: Model, count: int, highest: float = 0.0) -> Pencil | None:
    """The pencil by which one mode less than so many was counted, if it is kept and goes up to a frequency,
    rad/s.
    """
    kept = model._pencil
    return kept if kept and kept.counted[1] == count - 1 and kept.highest >= highest else None


def count_below(model: Model, frequency: float) -> int | None:
    """Number of modes below a frequency, Hz; None where the direct solver tells none. A small model keeps the
    pencil for these modes and one more. Collective.
    """
    known = np.empty(0) if model._modes is None else model._modes.frequencies
    if len(known) and known[-1] >= frequency:
        return int((known < frequency).sum())
    below, model._pencil = modes_below(model.statics, frequency)
    return below
