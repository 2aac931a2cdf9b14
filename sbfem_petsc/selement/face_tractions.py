"""Tractions on the two faces that meet in the scaling centre of an open S-element: contact and loads inside a
crack's tip element.

The faces carry no nodes. Their tractions are polynomials of the radial coordinate xi, and the S-element's own
radial equations carry these exactly. With tractions ``sum_t xi^t tau_t`` along a *direction* (a row d that
takes a relative displacement of the faces, or a component on one of them, from the boundary displacements), L
the length of the faces, K the stiffness, A = `SElement.radial` and F = E0^-1:

- The radial forces are ``q = K u - sum_t xi^(t+1) g_t tau_t`` with ``g_t = L (A^T + (t + 1) I)^-1 d^T``.
  Thus g_t tau_t are the equivalent nodal forces on the boundary, and by reciprocity g_t as a row gives the
  moment ``L int_0^1 xi^t d u dxi`` of what d takes.
- The displacement follows from ``xi u,xi = A u - sum_t xi^(t+1) F g_t tau_t``. A traction with the power of a
  homogeneous solution (uniform on one face of a crack) gives a logarithm; the equations in this form hold it.
- With the boundary held fixed the moments are ``C tau`` with the self-flexibility
  ``C_tt' = g_t^T F g_t' / (t + t' + 2)``, symmetric and positive definite.

The polynomials are the Bernstein polynomials of degree modes - 1: none is negative, so that coefficients >= 0
and mean gaps >= 0 are a complementarity problem as that of node pairs is.

Faces that close a wedge of the angle alpha press with ``-E' alpha / (4 pi) ln r`` next to the tip, as a wedge
disclination does (U = E' alpha / (8 pi) r^2 ln r), which no polynomial follows: without it closed faces leave
a K_I < 0. A last mode ``2 (xi - 1 - ln xi)`` (``-ln xi`` beside the uniform mode alone) has the logarithm, is
not negative either and has the mean 1. ``xi^t ln xi`` is the derivative of xi^t by t, and all that belongs to
it is the derivative of what belongs to xi^t: with the tractions as states ``xi^P s``, P = `growth` has the
powers t + 1 on its diagonal and couples the logarithm's state to that of the uniform traction.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from scipy import linalg
from scipy.special import comb

from .coefficients import SElementError, coefficient_matrices
from .dense import cholesky, cholesky_solve, lower_solve, symmetric
from .sectors import Sectors

# Reciprocity is met to about 1e-12 up to 200 unknowns; a wrong sign, length or coefficient matrix breaks it
# entirely.
TOLERANCE = 1e-8
# Of xi, in initial gaps: of straight faces, and of round ends as those of an open crack are.
GAP_POWERS = np.array([0.0, 0.5, 1.0, 1.5])


@dataclass(frozen=True, eq=False)
class FaceTractions:
    """Traction modes on the faces of a non-dimensional open S-element with n boundary unknowns.

    There are m = directions x modes coefficients, all modes of the first direction first, a logarithm last. A
    coefficient is the *force* of its mode: the traction is ``sum_k force_k / (L h thickness) b_k(xi)`` with
    the modes b_k (`shapes`), whose means are 1, so that the forces of a direction add up to the resultant.
    Its conjugate is the *mean* of what the direction takes, weighted with b_k. For an S-element of size h
    (m), modulus E (Pa) and a thickness (m), placed with a rotation R (`congruence.Placement`)::

        mean (m)         rows @ u + flexibility @ force / (E thickness) + initial mean     u (n,) in m
        nodal forces (N) rows.T @ force                          force (m,) in N
        node frame       rows.reshape(m, -1, 2) @ R              acts on the element's own displacements

    Rows, flexibility and initial means thus stand beside those of node pairs, and forces in N beside theirs.

    Attributes
    ----------
    rows : (m, n) array
        Means for boundary displacements; the same number per unit length in and out.
    flexibility : (m, m) array
        In units of 1 / (E thickness), symmetric, positive definite.
    directions : (d, 2, 2) array
        Vectors on the first and on the last face (node) for each direction, in the reference frame.
    modes : int
        Of each direction.
    logarithm : bool
        Whether the last of them is the logarithm.
    lengths : (d,) array
        Length of the loaded faces of each direction, in units of the size.
    forcing : (n, m) array
        ``xi u,xi = A u - forcing @ xi^growth @ monomials @ force``.
    growth : (m, m) array
        P.
    monomials : (m, m) array
        Coefficients of the monomials, and of -ln xi (stresses in units of E), from the forces in units of E h
        thickness.
    reciprocity : float
        Relative difference between the nodal forces of particular solutions and the moments' rows.
    """

    rows: np.ndarray
    flexibility: np.ndarray
    directions: np.ndarray
    modes: int
    logarithm: bool
    lengths: np.ndarray
    forcing: np.ndarray
    growth: np.ndarray
    monomials: np.ndarray
    reciprocity: float

    def initial_mean(self, factors: np.ndarray) -> np.ndarray:
        """(modes,): means of a quantity with such factors (4,) on xi^0, xi^(1/2), xi and xi^(3/2), as an
        initial gap has; in their unit.
        """
        levels, weights = _along_the_face(self.modes)
        return (weights[:, None] * self.shapes(levels)).T @ levels[:, None] ** GAP_POWERS @ factors

    def shapes(self, levels: np.ndarray) -> np.ndarray:
        """(l, modes): the modes, each of the mean 1, at levels in [0, 1]; a logarithm is infinite at 0."""
        polynomials = self.modes - self.logarithm
        values = polynomials * bernstein(polynomials, levels)
        if not self.logarithm:
            return values
        x = np.asarray(levels, dtype=float)
        with np.errstate(divide="ignore"):
            last = -np.log(x) if polynomials == 1 else 2.0 * (x - 1.0 - np.log(x))
        return np.column_stack([values, last])

    def traction(self, force: np.ndarray, levels: np.ndarray) -> np.ndarray:
        """Traction of each direction along the faces.

        Parameters
        ----------
        force : (m,) or (m, c) array
            N.
        levels : (l,) array
            xi: 0 at the tip, where a logarithm is infinite, 1 on the boundary.

        Returns
        -------
        (l, d) or (l, d, c) array
            To be divided by size and thickness for Pa.
        """
        force = np.asarray(force, dtype=float)
        split = force.reshape(len(self.lengths), self.modes, *force.shape[1:])
        scaled = split / self.lengths.reshape(-1, *[1] * (split.ndim - 1))
        # a logarithm that does not act leaves the traction finite at the tip
        acting = np.moveaxis(split, 1, 0).reshape(self.modes, -1).any(axis=1)
        return np.einsum("lk,dk...->ld...", self.shapes(levels)[:, acting], scaled[:, acting])

    def layer(self) -> np.ndarray:
        """(modes, modes): what an elastic layer between the faces, of the opening 1 for the pressure 1, adds
        to the flexibility of the first direction: its modes' pressures, weighted as the openings are; to be
        divided by size and thickness.
        """
        levels, weights = _along_the_face(self.modes)
        forces = np.eye(len(self.lengths) * self.modes, self.modes)
        pressures = self.traction(forces, levels)[:, 0]
        return self.lengths[0] * pressures.T @ (weights[:, None] * pressures)

    def uniform_force(self, traction: np.ndarray) -> np.ndarray:
        """(m,): forces of uniform tractions (d,); to be multiplied by size and thickness for Pa to give N."""
        shares = np.full(self.modes, 1.0 / (self.modes - self.logarithm))
        shares[self.modes - self.logarithm :] = 0.0
        return np.outer(np.asarray(traction, dtype=float) * self.lengths, shares).ravel()

    def inflow(self, force: np.ndarray, levels: np.ndarray) -> np.ndarray:
        """(l, n, c): what the tractions add to ``xi u,xi - A u``, for forces (m, c) / (E thickness), in m."""
        return -(self.forcing @ (_grown(self.growth, levels) @ (self.monomials @ force)))


@functools.cache
def _along_the_face(modes: int) -> tuple[np.ndarray, np.ndarray]:
    """Levels and weights of integrals of products of two modes.

    The powers of Gauss points integrate polynomials exactly, and a logarithm at the tip to round-off.
    """
    power = 8
    at, weights = np.polynomial.legendre.leggauss(power * modes)
    at = 0.5 * (at + 1.0)
    return at**power, 0.5 * weights * power * at ** (power - 1)


def _grown(growth: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """(l, m, m): xi^P. P couples states of one power alone: its part off the diagonal comes with ln xi."""
    xi, powers = np.asarray(levels, dtype=float)[:, None, None], growth.diagonal()
    logarithm = np.log(np.where(xi > 0.0, xi, 1.0))
    return xi ** powers[:, None] * (np.eye(len(growth)) + logarithm * (growth - np.diag(powers)))


def bernstein(modes: int, levels: np.ndarray) -> np.ndarray:
    """(l, modes): Bernstein polynomials of degree modes - 1 at the levels in [0, 1]."""
    x, k = np.asarray(levels, dtype=float)[:, None], np.arange(modes)
    return comb(modes - 1, k) * x**k * (1.0 - x) ** (modes - 1 - k)


def face_axis(shape: np.ndarray) -> np.ndarray:
    """(2,): unit vector from the scaling centre into the gap between the faces, their bisector."""
    first, last = (shape[i] / np.linalg.norm(shape[i]) for i in (0, -1))
    axis = first + last
    if np.linalg.norm(axis) < 1e-6:  # a straight boundary has no gap: the outward normal
        return np.array([first[1], -first[0]])
    return axis / np.linalg.norm(axis)


def opening_direction(shape: np.ndarray) -> np.ndarray:
    """(2, 2): the direction of the faces' opening, normal to their axis.

    The chain of nodes is counter-clockwise, so the first face lies on the left of the axis. Forces are
    compressive contact forces where positive.
    """
    x, y = face_axis(shape)
    return np.array([[-y, x], [y, -x]])


def single_face_directions(face: int) -> np.ndarray:
    """(2, 2, 2): tractions along x and y of the reference frame on face 0 (first node) or 1 (last node)."""
    directions = np.zeros((2, 2, 2))
    directions[:, face] = np.eye(2)
    return directions


def face_tractions(
    sectors: Sectors,
    *,
    stiffness: np.ndarray,
    radial: np.ndarray,
    directions: np.ndarray | None = None,
    modes: int = 4,
    logarithm: bool = False,
) -> FaceTractions:
    """Traction modes on the faces of an open S-element.

    Parameters
    ----------
    sectors : Sectors
    stiffness, radial : (n, n) arrays
        K and A of the S-element.
    directions : (d, 2, 2) array, optional
        Vectors on the first and last face; default: the opening alone (`opening_direction`). Loads
        and friction use `single_face_directions`.
    modes : int
        Polynomials a direction, at least 1 (constant).
    logarithm : bool
        One mode more a direction, for faces that close a wedge.

    Raises
    ------
    SElementError
        If reciprocity is violated: the nodal forces of a particular solution are not the row of the moments.
    ValueError
        If `modes` is not at least 1.
    """
    if modes < 1:
        raise ValueError(f"modes = {modes!r} must be at least 1: the number of traction polynomials")
    shape, order, elasticity = sectors
    directions = opening_direction(shape)[None] if directions is None else np.asarray(directions, dtype=float)
    coefficients = coefficient_matrices(shape, order, False, elasticity)
    n, count = len(radial), len(directions)
    faces = np.linalg.norm(shape[[0, -1]], axis=1)
    loaded = np.abs(directions).max(axis=2) > 0.0
    lengths = (loaded @ faces) / loaded.sum(axis=1)
    d = np.zeros((count, n))
    d[:, :2], d[:, -2:] = directions[:, 0], directions[:, 1]
    loads = lengths * d.T  # (n, d): L d^T

    def moments(powers: np.ndarray) -> np.ndarray:
        """(powers, n, d): g of the monomials xi^(power - 1)."""
        return np.linalg.solve(radial.T + powers[:, None, None] * np.eye(n), loads[None])

    powers = np.arange(1.0, modes + 1.0)
    # between the modes' exponents, where a particular solution is a pure power
    between = (powers + 0.25)[:, None, None]
    skew = coefficients.e1 - coefficients.e1.T
    particular = np.linalg.solve(
        between**2 * coefficients.e0 - between * skew - coefficients.e2, -loads[None]
    )
    force = (stiffness - between * coefficients.e0 - coefficients.e1.T) @ particular
    expected = moments(between.ravel())
    apart = np.abs(force - expected).max(axis=(1, 2)) / np.abs(expected).max(axis=(1, 2))
    reciprocity = float(apart.max())
    if not reciprocity < TOLERANCE:
        raise SElementError(
            f"the reciprocity of its face tractions is violated by {reciprocity:.2g} (round-off is at most "
            f"{TOLERANCE:.0g}): the radial solution is inaccurate; use a lower order or a rounder tip element"
        )
    table, growth = [*moments(powers)], np.diag(powers)
    if logarithm:
        # of -ln xi: the derivative of those of xi^t by -t at t = 0
        table.append(np.linalg.solve(radial.T + np.eye(n), table[0]))
        growth = linalg.block_diag(growth, 1.0)
        growth[0, -1] = -1.0
    rows = np.stack(table).transpose(2, 0, 1).reshape(-1, n)  # from (modes, n, d)
    factor = cholesky(coefficients.e0, "coefficient matrix E0")
    forcing = cholesky_solve(factor, rows.T)
    growth = np.kron(np.eye(count), growth)
    monomials = np.kron(np.diag(1.0 / lengths), _monomials(modes, logarithm))
    # int_0^1 r^T F r dxi / xi of the modes' r = rows^T xi^P monomials: positive even where monomials cancel
    levels, weights = _along_the_face(modes + logarithm)
    states = np.sqrt(weights / levels)[:, None, None] * (_grown(growth, levels) @ monomials)
    root = np.linalg.qr(lower_solve(factor, rows.T), mode="r") @ states
    root = root.reshape(-1, root.shape[2])
    return FaceTractions(
        monomials.T @ rows,
        symmetric(root.T @ root),
        directions,
        modes + logarithm,
        logarithm,
        lengths,
        forcing,
        growth,
        monomials,
        reciprocity,
    )


def _monomials(polynomials: int, logarithm: bool) -> np.ndarray:
    """(modes, modes): column k holds the coefficients of xi^0, xi^1 ..., and of -ln xi, of mode k."""
    degree, modes = polynomials - 1, polynomials + logarithm
    table = np.zeros((modes, modes))
    for k in range(polynomials):
        for t in range(k, polynomials):
            table[t, k] = polynomials * comb(degree, t) * comb(t, k) * (-1.0) ** (t - k)
    if logarithm and polynomials == 1:
        table[-1, -1] = 1.0
    elif logarithm:
        table[[0, 1, -1], -1] = -2.0, 2.0, 2.0
    return table
