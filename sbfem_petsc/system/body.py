"""What a model was made of, beside its results in files."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, ClassVar

import numpy as np

from ..petsc import PETSc, SLEPc, all_asked
from ..ranks.parallel import whole
from ..record.record import Record, described, quantity
from .structure import Structure

# Numbers of a model, and what its pairs hold of each.
_OF_MODEL = ("thickness", "continued_fraction", "order", "boundary_unknowns", "unknowns")
_OF_PAIRS = ("nodes", "normal", "gap", "crack", "position")


@described
class Body(Record):
    """Inputs and mesh of a model, and with what they were computed. Materials and supports are texts."""

    labels: ClassVar = {"crack": "cracks"}

    thickness: float = quantity("m", "thickness of the structure")
    damping: np.ndarray = quantity(
        "1", "modal damping ratios of dynamic analyses: of all modes, of each mode or by frequency", "ratio"
    )
    damping_frequency: np.ndarray = quantity(
        "Hz", "frequencies of the ratios; nan unless they are by frequency", "ratio", finite=False
    )
    rayleigh: np.ndarray = quantity(
        "SI", "factors a (1/s) and b (s) of the damping a M + b K beside it", "factor"
    )
    continued_fraction: int = quantity("1", "terms of the continued fraction")
    order: int = quantity("1", "polynomial order of the edges")
    ranks: int = quantity("1", "MPI ranks that computed it")
    boundary_unknowns: int = quantity(
        "1", "displacement unknowns on the boundaries of S-elements, supports taken off"
    )
    unknowns: int = quantity("1", "the same with all auxiliary unknowns")
    materials: tuple[str, ...] = quantity(text="materials by their numbers", dims="material")
    supports: tuple[str, ...] = quantity(text="supports", dims="support")
    edge_sets: tuple[str, ...] = quantity(text="named sets of edges", dims="edge_set")
    points: dict[str, np.ndarray] = quantity("m", "coordinates of the named points", "place xy")
    cracks: tuple[str, ...]
    crack_tip: np.ndarray = quantity("m", "coordinates of the tips", "crack xy")
    crack_axis: np.ndarray = quantity("1", "unit vectors from the tips to the mouths", "crack xy")
    crack_opening: np.ndarray = quantity("rad", "total angle between the faces", "crack")
    crack_length: np.ndarray = quantity("m", "length along the axis", "crack")
    pair_nodes: np.ndarray = quantity(
        "1", "node on the face the normal points to, node on the opposite face", "pair face", kinds="iu"
    )
    pair_normal: np.ndarray = quantity("1", "unit normals of the pairs", "pair xy")
    pair_gap: np.ndarray = quantity("m", "initial gaps", "pair")
    pair_crack: np.ndarray = quantity("1", "number of the crack, from 0", "pair", kinds="iu")
    pair_position: np.ndarray = quantity("1", "fraction of the crack's length from its first tip", "pair")
    nodes: np.ndarray = quantity("m", "coordinates of the nodes", "node xy")
    scaling_centres: np.ndarray = quantity("m", "scaling centres of the S-elements", "element xy")
    closed: np.ndarray = quantity("1", "whether the boundary is a loop", "element", kinds="b")
    element_materials: np.ndarray = quantity(
        "1", "numbers of materials; at an interface that of the first edge's sector", "element", kinds="iu"
    )
    element_nodes_count: np.ndarray = quantity("1", "number of boundary nodes", "element", kinds="iu")
    element_nodes: np.ndarray = quantity(
        "1", "boundary nodes, counter-clockwise, one S-element after the other", "entry", kinds="iu"
    )
    petsc_options: tuple[str, ...] = quantity(text="PETSc's options", dims="option")
    versions: tuple[str, ...] = quantity(text="versions of PETSc, SLEPc and NumPy", dims="library")

    @classmethod
    def of(cls, model: Structure, damping: np.ndarray, rayleigh: tuple[float, float]) -> Body | None:
        """Of a structure and its damping, rows of frequency (Hz) and ratio; on rank 0, None elsewhere.
        Collective.
        """
        mesh = _mesh(model)
        if mesh is None:
            return None
        pairs, cracks = model.pairs, model.cracks
        frequencies, ratios = damping.T
        versions = {"petsc": PETSc.Sys, "slepc": SLEPc.Sys}
        return cls(
            **mesh,
            **{name: getattr(model, name) for name in _OF_MODEL},
            damping=ratios,
            damping_frequency=frequencies,
            rayleigh=np.array(rayleigh, dtype=float),
            ranks=model.comm.size,
            materials=tuple(
                f"{n}: {_exact(m)}" for n, m in zip(model.layout.material_names, model.materials)
            ),
            supports=tuple(map(_exact, model.supports)),
            edge_sets=tuple(model.layout.edge_sets),
            points={name: np.array(at, dtype=float) for name, (at, *_) in model.points.items()},
            cracks=tuple(crack.name for crack in cracks),
            crack_tip=np.array([crack.tip for crack in cracks]).reshape(-1, 2),
            crack_axis=np.array([crack.axis for crack in cracks]).reshape(-1, 2),
            crack_opening=np.array([crack.opening for crack in cracks]),
            crack_length=np.array([crack.length for crack in cracks]),
            **{f"pair_{name}": getattr(pairs, name) for name in _OF_PAIRS},
            petsc_options=tuple(f"{name} {value or ''}".strip() for name, value in all_asked().items()),
            versions=(
                *(f"{name} {'.'.join(map(str, of.getVersion()))}" for name, of in versions.items()),
                f"numpy {np.__version__}",
            ),
        )

    def __repr__(self) -> str:
        pairs = len(self.pair_gap)
        return f"Body({len(self.nodes)} nodes, {len(self.closed)} S-elements, {pairs} contact pairs)"


def _exact(item: Any) -> str:
    """A dataclass with all digits of its numbers."""
    return f"{type(item).__name__}({', '.join(f'{f.name}={getattr(item, f.name)!r}' for f in fields(item))})"


def _mesh(model: Structure) -> dict[str, Any] | None:
    """Nodes and S-elements of all ranks, on rank 0. Collective."""
    part, comm = model.layout.part, model.comm
    numbers = np.array([model.cells.named_materials(int(k))[0] for k in part.materials], dtype=np.int64)
    own = {"scaling_centres": part.centres, "closed": part.closed, "element_materials": numbers}
    found: dict[str, Any] = {name: whole(comm, part.elements, values) for name, values in own.items()}
    found["nodes"] = whole(comm, part.nodes, part.coordinates)
    parts = comm.gather({int(k): part.nodes[chain] for k, chain in zip(part.elements, part.chains)})
    if parts is None:
        return None
    chains = [chain for _, chain in sorted(item for several in parts for item in several.items())]
    counts = np.array([len(chain) for chain in chains], dtype=np.int64)
    return {**found, "element_nodes_count": counts, "element_nodes": np.concatenate(chains)}
