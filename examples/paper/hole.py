"""Fig. 12: the beam with a hole."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from sbfem_petsc.plot import plot_discretisation, save_picture

from .bench import Bench
from .findings import Claim, Finding, Part, Table, percent


def geometry(bench: Bench) -> Finding:
    """Mesh and natural frequencies of the beam with a hole, with and without a crack."""
    found, exact, error = {}, {}, {}
    for case, name in (("hole, healthy", "hole_healthy_nu33"), ("hole, cracked", "hole_crack80_nu33")):
        exact[case] = np.array(bench.reference["modes"][name]["frequency_Hz"])
        found[case] = sb.modal(bench.model(case), len(exact[case])).frequencies
        error[case] = float(np.abs(found[case] / exact[case] - 1.0).max())
    shift = found["hole, cracked"] / found["hole, healthy"] - 1.0
    rows = [
        [str(k + 1), *(array[k] for case in found for array in (found[case], exact[case])), shift[k]]
        for k in range(len(shift))
    ]
    model = bench.model("hole, cracked")
    mesh = bench.beam("hole, cracked").mesh()
    beam = bench.beam("hole, cracked")
    rim = mesh.nodes[np.unique(mesh.edges[np.asarray(mesh.edge_sets["hole1"])])]
    roundness = float(
        np.abs(
            np.linalg.norm(rim - [beam.holes[0].x, beam.holes[0].y], axis=1) / beam.holes[0].radius - 1.0
        ).max()
    )
    numbers = {
        "largest_error": error,
        "frequencies": found,
        "shift": shift,
        "boundary_unknowns": model.boundary_unknowns,
        "contact_pairs": len(model.pairs),
        "roundness": roundness,
    }
    claims = [
        Claim(
            "frequencies 1-24 agree with the reference within 3e-5",
            f"largest errors {error['hole, healthy']:.1e} (healthy), {error['hole, cracked']:.1e} (cracked)",
            max(error.values()) < 3e-5,
            "check",
        ),
        Claim(
            "nodes on the hole are on the circle",
            f"largest relative distance {roundness:.0e}",
            roundness < 1e-12,
            "check",
        ),
        Claim(
            "the linear response of the cracked beam is not distinct from the healthy one's",
            f"the open crack shifts f1 by {percent(shift[0])} and mode {int(np.argmin(shift)) + 1} by "
            f"{percent(shift.min())}",
            bool(np.abs(shift).max() < 1e-3),
        ),
    ]
    tables = [
        Table(
            "Natural frequencies of the beam with a hole, Hz",
            ["mode", "healthy", "reference", "cracked", "reference", "shift by the crack"],
            rows,
            ["text", "frequency", "frequency", "frequency", "frequency", "percent"],
        )
    ]
    return Finding(
        numbers,
        tables,
        claims,
        ["The hole is 2.5 mm in diameter at mid-height, x = 65 mm; the crack is 1.5 mm deep at 80 mm."],
    )


def draw_geometry(finding: Finding, path: str) -> None:
    """The discretisation."""
    save_picture(plot_discretisation(Bench().beam("hole, cracked").mesh(), comm=Bench.comm), path)


PARTS = [
    Part(
        "fig12",
        "Fig. 12: beam with a hole",
        geometry,
        draw_geometry,
        "S-elements of the beam with a hole: the whole beam, the crack, its tip.",
        1.0,
    )
]
