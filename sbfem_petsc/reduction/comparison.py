"""Whether two reduced models are of the same structure and loads, and one in the place of the other."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from .outputs import LinearOutput
from .reduced_model import ReducedModel

# Relative differences of the same model on other numbers of ranks.
SAME = 1e-5
_SHARES = ("modes", "loads", "contact")


def in_rows(reduced: ReducedModel) -> ReducedModel:
    """The same with all arrays contiguous, row by row, as they come from a file: BLAS rounds products of
    others differently.
    """

    def rows(item):
        if isinstance(item, np.ndarray):
            return np.ascontiguousarray(item)
        if isinstance(item, LinearOutput):
            return LinearOutput(item.names, *(np.ascontiguousarray(getattr(item, s)) for s in _SHARES))
        return item

    return replace(reduced, **{f.name: rows(getattr(reduced, f.name)) for f in fields(reduced)})


def difference(one: ReducedModel, other: ReducedModel) -> str:
    """What tells two reduced models apart, "" if nothing; signs of modes and rounding by other numbers of
    ranks do not.
    """
    if one.points.names != other.points.names or one.tips.names != other.tips.names:
        return "its points or cracks differ"
    if one.in_words != other.in_words:
        return f"{one.in_words}, not {other.in_words}"
    for text, a, b in (
        ("contact rows", one.initial_gap, other.initial_gap),
        ("loads", one.load_modes.T, other.load_modes.T),
    ):
        if len(a) != len(b):
            return f"{len(a)} {text}, not {len(b)}"
    if not np.allclose(
        one.frequencies, other.frequencies, rtol=SAME, atol=SAME * other.frequencies[-1] * 1e-3
    ):
        worst = int(np.argmax(np.abs(one.frequencies - other.frequencies)))
        return (
            f"frequency {worst + 1} is {one.frequencies[worst]:.7g} Hz, not {other.frequencies[worst]:.7g} Hz"
        )
    if other.friction is not one.friction and not (one.friction and one.friction.same(other.friction)):
        return "its friction differs"
    if not one.contact_laws.same(other.contact_laws):
        return "its contact laws differ"
    if not close(one.damping, other.damping):
        return "its damping differs"
    # static compliances, modes and residual together: the same whatever the signs of the modes
    for text, of in (
        ("initial gaps", lambda r: r.initial_gap),
        ("contact rows' compliance", lambda r: _compliance(r.gap.modes, r.omega) + r.gap.contact),
        ("loads' compliance", lambda r: _compliance(r.load_modes.T, r.omega) + r.load_flexibility),
        ("loads on the pairs", lambda r: _compliance(r.gap.modes, r.omega, r.load_modes.T) + r.gap.loads),
    ):
        if not close(of(one), of(other)):
            return f"its {text} differ"
    return ""


def adopted(stored: ReducedModel, given: ReducedModel) -> ReducedModel:
    """A reduced model from a file with the model, modes and loads of an equal one that was made anew.

    Modes whose sign another solve has turned round are turned back; where they cannot be (multiple
    frequencies) the result has no model, and so no fields.
    """
    stored = replace(stored, loads=given.loads, wider=given.wider, lag=given.lag)
    if given.model is None or given.modal is None:
        return stored

    def seen(r: ReducedModel) -> np.ndarray:
        """What of the modes does not depend on where they are computed."""
        parts = (r.points.modes, r.gap.modes, r.load_modes.T, r.translation.T)
        flat = [part.reshape(-1, len(r.omega)) for part in parts]
        return np.concatenate([part / max(np.abs(part).max(initial=0.0), 1e-300) for part in flat])

    mine, other = seen(stored), seen(given)
    signs = np.where((mine * other).sum(axis=0) < 0.0, -1.0, 1.0)
    if not close(signs * other, mine):
        return stored
    of_vectors = None if given.vector_shapes is None else given.vector_shapes * signs[given.natural :]
    signs = signs[: given.natural]
    modal = replace(
        given.modal,
        shapes=given.modal.shapes * signs,
        point_shapes={name: shape * signs[:, None] for name, shape in given.modal.point_shapes.items()},
        auxiliary_inertia=given.modal.auxiliary_inertia * signs[:, None],
    )
    return replace(stored, model=given.model, modal=modal, vector_shapes=of_vectors)


def close(one, other) -> bool:
    """Whether two settings are the same: numbers to 1e-9, arrays to `SAME` of their largest value, texts and
    lists of them in each letter.
    """
    if isinstance(one, (str, list)) or isinstance(other, (str, list)):
        return bool(one == other)
    one, other = 1.0 * np.asarray(one), 1.0 * np.asarray(other)
    scale = SAME * np.abs(other).max(initial=0.0) if one.ndim else 0.0
    return one.shape == other.shape and bool(
        np.allclose(one, other, rtol=1e-9 if one.ndim == 0 else SAME, atol=scale)
    )


def _compliance(left: np.ndarray, omega: np.ndarray, right: np.ndarray | None = None) -> np.ndarray:
    elastic = omega > 1e-6 * omega[-1]
    return (left[:, elastic] / omega[elastic] ** 2) @ (left if right is None else right)[:, elastic].T
