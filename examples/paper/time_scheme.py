"""Contact and time integration as the paper has them, eqs. (25)-(34): pairs that penetrate are tied in one
pass, tension allowed, and the multiplier is carried in the acceleration. They are there to be compared with:
contact feeds energy in without bound, the sooner the smaller the step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse.linalg import splu

import sbfem_petsc as sb

# The integration is stopped when its energy exceeds what was supplied by this factor.
RUNAWAY = 1.1


def tied_in_one_pass(flexibility: np.ndarray, free_gap: np.ndarray) -> np.ndarray:
    """Forces (30)-(34) of the single correction: every penetrating pair is tied, tension is not released."""
    force, touching = np.zeros(len(free_gap)), free_gap < 0.0
    force[touching] = np.linalg.solve(flexibility[np.ix_(touching, touching)], -free_gap[touching])
    return force


class Tied(NamedTuple):
    """At rest with pairs that are tied in one pass.

    Attributes
    ----------
    displacements : dict of str to (2,) array
        Of the named points, m.
    free_gap, force, gap : (c,) arrays
        Of the contact rows: gaps without contact, m, forces, N, and gaps with them.
    compliance : (c, c) array
        G K^-1 G', m/N.
    """

    displacements: dict[str, np.ndarray]
    free_gap: np.ndarray
    force: np.ndarray
    gap: np.ndarray
    compliance: np.ndarray


def at_rest(reduced: sb.ReducedModel, force: float) -> Tied:
    """Statics of a reduced model of one load, whose residual flexibility makes it exact."""
    gap, load, square = reduced.gap, np.array([[force]]), reduced.omega**2
    compliance = (gap.modes / square) @ gap.modes.T + gap.contact
    pushed, none = force * reduced.load_modes[:, 0] / square, np.zeros((1, len(compliance)))
    free = gap(pushed[None], load, none)[0] + reduced.initial_gap
    tied = tied_in_one_pass(compliance, free)
    moved = reduced.points((pushed + gap.modes.T @ tied / square)[None], load, tied[None])[0]
    places = dict(zip(reduced.points.names, moved))
    return Tied(places, free, tied, free + compliance @ tied, compliance)


class Run(NamedTuple):
    """Steps of the paper's integration.

    Attributes
    ----------
    time : (n,) array
        s.
    energy, work : (n,) arrays
        Kinetic and strain energy, and what the load has done, J.
    resultant : (n,) array
        Of all contact rows, N.
    stopped : bool
        Whether the energy ran away.
    """

    time: np.ndarray
    energy: np.ndarray
    work: np.ndarray
    resultant: np.ndarray
    stopped: bool


def integrate(model: sb.Model, load, signal, step: float, count: int) -> Run:
    """Average acceleration with contact, eqs. (28)-(34), from rest.

    Parameters
    ----------
    model : Model
        On one rank, undamped; contact nodes have mass.
    load : PointForce
        Of unit size.
    signal : Signal
        By which it changes.
    step : float
        s.
    count : int
        Number of steps.
    """
    parts, columns = model.matrices(), model.load_columns([load])
    inertia = 4.0 / step**2
    factor = splu((inertia * parts.mass + parts.stiffness).tocsc(), permc_spec="MMD_AT_PLUS_A")
    push = np.zeros(parts.mass.shape[0])
    push[: len(columns.forces)] = columns.forces[:, 0]
    responses = factor.solve(parts.gaps.T.toarray())
    flexibility = parts.gaps @ responses + parts.flexibility
    u = v = np.zeros(len(push))
    mass_v = stiffness_u = np.zeros(len(push))
    carried, work, stopped = np.zeros(len(parts.initial)), 0.0, False
    amplitudes = signal(step * np.arange(count + 1))
    rows = [(0.0, 0.0, 0.0, 0.0)]
    supplied = 0.0
    for k in range(count):
        drive = amplitudes[k] + amplitudes[k + 1]
        right = 2.0 * (2.0 / step * mass_v - stiffness_u) + drive * push + parts.gaps.T @ carried
        d = factor.solve(right)
        gap = parts.gaps @ (u + d) + parts.initial + amplitudes[k + 1] * columns.gaps[:, 0]
        carried = tied_in_one_pass(flexibility, gap)
        d += responses @ carried
        work += 0.5 * drive * (push @ d)
        u, v = u + d, 2.0 / step * d - v
        mass_v, stiffness_u = parts.mass @ v, parts.stiffness @ u
        stored = 0.5 * carried @ parts.flexibility @ carried
        energy, supplied = 0.5 * (v @ mass_v + u @ stiffness_u) + stored, max(supplied, abs(work))
        rows.append((step * (k + 1), energy, work, carried.sum()))
        if k > 20 and energy > RUNAWAY * supplied:
            stopped = True
            break
    return Run(*np.array(rows).T, stopped)
