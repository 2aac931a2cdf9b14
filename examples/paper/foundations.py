"""Eqs. (1)-(19): line elements, stiffness, mass and continued fraction of one S-element, held against
closed forms and book values.
"""

from __future__ import annotations

import numpy as np
from matplotlib.ticker import MaxNLocator
from scipy import linalg

import sbfem_petsc as sb
from meshing.gll import gll_nodes
from sbfem_petsc.plot.drawing import CYCLE, MARKERS, figure, save_picture, style
from sbfem_petsc.selement.sectors import Sectors
from sbfem_petsc.selement.solution import solve_selement

from .findings import Claim, Finding, Part, Table

# First rows of K and M of the square (+-1)^2 with two-node edges, E = 10, nu = 0, rho = 2 (Song, The Scaled
# Boundary Finite Element Method, 2018).
BOOK = {
    "K": [4.8936, 1.25, -2.3936, -1.25, -2.6064, -1.25, 0.1064, 1.25],
    "M": [0.8954, 0.0851, 0.4380, 0.0, 0.2287, 0.0851, 0.4380, 0.0],
}
TERMS = (0, 1, 2, 3, 4, 6)


def polygon(corners: np.ndarray, order: int) -> np.ndarray:
    """(nodes, 2): GLL nodes on the edges of a polygon about the origin."""
    fraction = 0.5 * (1.0 + gll_nodes(order))[:-1, None]
    return np.concatenate(
        [start + fraction * (end - start) for start, end in zip(corners, np.roll(corners, -1, axis=0))]
    )


def square(order: int, half: float) -> np.ndarray:
    """Nodes of a square about the origin."""
    return polygon(half * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]]), order)


def elasticity(poisson: float) -> np.ndarray:
    """(3, 3): D / E of plane stress."""
    return sb.Material(1.0, poisson, 1.0).elasticity


def circular(element, keep=None) -> np.ndarray:
    """Circular frequencies of one S-element with its auxiliary unknowns, E = rho = 1."""
    stiffness = linalg.block_diag(element.stiffness, np.eye(element.inertia.size))
    mass = np.block([[element.mass, element.coupling], [element.coupling.T, np.diag(element.inertia)]])
    if keep is not None:
        index = np.concatenate([np.flatnonzero(keep), np.arange(len(keep), len(mass))])
        stiffness, mass = stiffness[np.ix_(index, index)], mass[np.ix_(index, index)]
    return np.sqrt(np.abs(linalg.eigh(stiffness, mass, eigvals_only=True)))


def line_elements(bench) -> Finding:
    """Eqs. (1)-(11): book values, uniform strain on an irregular polygon, and the Lame mode over the
    order.
    """
    book = solve_selement(Sectors(square(1, 1.0), 1, elasticity(0.0)), True, 0)
    rows = {"K": 10.0 * book.stiffness[0], "M": 2.0 * book.mass[0]}
    error = max(float(np.abs(rows[name] - BOOK[name]).max()) for name in BOOK)
    irregular = np.array([[-1.0, -0.7], [0.9, -1.1], [1.3, 0.4], [0.2, 1.2], [-1.1, 0.8]])
    orders = np.arange(1, 13)
    exact = np.sqrt(2.0) * np.pi * np.sqrt(0.5 / 1.3)
    patch, lame = [], []
    for order in orders:
        nodes = polygon(irregular, int(order))
        element = solve_selement(Sectors(nodes, int(order), elasticity(0.3)), True, 0)
        strain = np.array([1.0, -0.4, 0.6])  # xx, yy, 2 xy
        uniform = (nodes @ np.array([[strain[0], 0.5 * strain[2]], [0.5 * strain[2], strain[1]]])).ravel()
        area = 0.5 * abs(
            np.sum(
                irregular[:, 0] * np.roll(irregular[:, 1], -1)
                - irregular[:, 1] * np.roll(irregular[:, 0], -1)
            )
        )
        energy = area * strain @ elasticity(0.3) @ strain
        patch.append(abs(uniform @ element.stiffness @ uniform / energy - 1.0))
        found = circular(
            solve_selement(Sectors(square(int(order), 0.5), int(order), elasticity(0.3)), True, 4)
        )
        lame.append(np.abs(found / exact - 1.0).min())
    numbers = {"book_error": error, "patch_error": max(patch), "orders": orders, "lame_error": lame}
    claims = [
        Claim(
            "first rows of K and M of a square are those of the literature to the four digits printed there",
            f"largest difference {error:.1e}",
            error < 6e-5,
            "check",
        ),
        Claim(
            "a uniform strain has its exact energy in an irregular pentagon at every order",
            f"largest relative error {max(patch):.1e} for p = 1 to {orders[-1]}",
            max(patch) < 1e-10,
            "check",
        ),
        Claim(
            "line elements of any order with GLL nodes converge exponentially",
            f"the Lamé mode of a free square is off by {lame[1]:.1e} (p = 2), {lame[3]:.1e} (p = 4), "
            f"{lame[7]:.1e} (p = 8)",
            bool(lame[7] < 1e-5 * lame[1]),
        ),
    ]
    tables = [
        Table(
            "First rows of K (E = 10) and M (ρ = 2) of the square (±1)², two-node edges, ν = 0",
            ["", *(str(k) for k in range(1, 9))],
            [
                row
                for name in BOOK
                for row in (
                    [f"{name}, literature", *BOOK[name]],
                    [f"{name}, sbfem-petsc", *np.round(rows[name], 4)],
                )
            ],
            ["text"] + ["value"] * 8,
        )
    ]
    return Finding(
        numbers,
        tables,
        claims,
        ["With four terms of the continued fraction round-off is reached at p = 8."],
        {"orders": orders, "lame": np.array(lame)},
    )


def draw_line_elements(finding: Finding, path: str) -> None:
    """Error of the Lame mode over the order."""
    drawing = figure(2.6, 4.6)
    axes = drawing.subplots()
    axes.semilogy(
        finding.curves["orders"],
        finding.curves["lame"],
        color=CYCLE[0],
        marker="o",
        markersize=4,
        linewidth=1.0,
    )
    axes.set_xlabel("order p of the line elements")
    axes.set_ylabel("relative error of ω")
    axes.set_title("Lamé mode of a free square, one S-element", fontsize=8)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.grid(color="#DDDDDD", linewidth=0.4)
    style(axes)
    save_picture(drawing, path)


def continued_fraction(bench) -> Finding:
    """Eqs. (12)-(19): modes of a square on roller edges over the terms of the continued fraction."""
    coordinates = square(16, 0.5)
    keep = np.stack([np.abs(np.abs(coordinates[:, k]) - 0.5) > 1e-9 for k in (0, 1)], axis=1).ravel()
    m, n = np.meshgrid(np.arange(30), np.arange(30))
    radius = np.pi * np.hypot(m, n)
    exact = np.sort(
        np.concatenate(
            [radius[(m + n) > 0] / np.sqrt(1.0 - 0.3**2), radius[(m > 0) & (n > 0)] * np.sqrt(0.5 / 1.3)]
        )
    )
    errors, good, residual = {}, {}, {}
    for terms in TERMS:
        element = solve_selement(Sectors(coordinates, 16, elasticity(0.3)), True, terms)
        found = circular(element, keep)
        count = min(len(found), 120)
        errors[terms] = np.abs(found[:count] / exact[:count] - 1.0)
        good[terms] = int(np.argmax(errors[terms] >= 0.01))
        residual[terms] = element.riccati_residual
    known = {0: 0, 1: 3, 2: 15, 3: 26, 4: 50, 6: 100}
    claims = [
        Claim(
            "K from the Riccati equation (12) is exact to round-off",
            f"relative residual {residual[0]:.1e}, asymmetry {element.asymmetry:.1e}, rigid-body forces "
            f"{element.rigid_body_residual:.1e}",
            residual[0] < 1e-10,
            "check",
        ),
        Claim(
            "each term of the continued fraction extends the range of frequencies",
            f"modes within 1 %: {', '.join(f'{good[t]} (Mcf = {t})' for t in TERMS)}",
            bool((np.diff(list(good.values())) > 0).all()),
        ),
        Claim(
            "as many modes as in an independent prototype",
            f"{list(good.values())} and {list(known.values())}",
            good == known,
            "check",
        ),
    ]
    tables = [
        Table(
            "Square on roller edges, one S-element of order 16: lowest modes within 1 % of the exact "
            "frequencies",
            ["terms Mcf", "modes within 1 %", "auxiliary unknowns"],
            [[str(t), good[t], t * 2 * len(coordinates)] for t in TERMS],
            ["text", "count", "count"],
        )
    ]
    curves = {"exact": exact[:120], **{f"terms_{t}": errors[t] for t in TERMS}}
    return Finding(
        {"modes_within_1_percent": good, "riccati_residual": residual[0]}, tables, claims, [], curves
    )


def draw_continued_fraction(finding: Finding, path: str) -> None:
    """Errors of the frequencies for each number of terms."""
    drawing = figure(3.0)
    axes = drawing.subplots()
    for k, terms in enumerate(TERMS):
        error = finding.curves[f"terms_{terms}"]
        axes.semilogy(
            finding.curves["exact"][: len(error)],
            np.maximum(error, 1e-13),
            color=CYCLE[k],
            marker=MARKERS[k],
            markersize=3,
            markeredgewidth=0,
            linestyle="none",
            label=f"$M_{{cf}}$ = {terms}",
        )
    axes.axhline(0.01, color="#777777", linewidth=0.6, linestyle=(0, (4, 2)))
    axes.text(0.5, 0.012, "1 %", fontsize=7, verticalalignment="bottom")
    axes.set_xlim(0.0, 22.0)
    axes.set_ylim(1e-12, 3.0)
    axes.set_xlabel(r"exact circular frequency $\omega L\sqrt{\rho/E}$")
    axes.set_ylabel("relative error")
    style(axes)
    drawing.legend(fontsize=7, frameon=False, ncols=len(TERMS), loc="outside upper center")
    save_picture(drawing, path)


PARTS = [
    Part(
        "eq1",
        "Eqs. 1-11: line elements and coefficient matrices",
        line_elements,
        draw_line_elements,
        "Relative error of the Lamé mode of a free square, one S-element with four terms of the continued "
        "fraction, over the order of its edges.",
        0.5,
    ),
    Part(
        "eq12",
        "Eqs. 12-19: stiffness, mass and continued fraction",
        continued_fraction,
        draw_continued_fraction,
        "Relative error of the natural frequencies of a square on roller edges, one S-element of order 16, "
        "for 0 to 6 terms of the continued fraction.",
        1.0,
    ),
]
