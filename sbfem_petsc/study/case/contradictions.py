"""What single keys cannot tell: names that do not exist, tables that contradict each other."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Sequence
from typing import Any

from .geometry import MESH_KEYS
from .loads import COMPONENTS
from .problems import Path, Problem, one_of
from .sweep import MOST

# Names that the summary of a run uses itself.
RESERVED = ("run",)
# Names of files, and of groups in them, and bytes of a name that leave room for endings.
_FILED, _LONGEST = re.compile(r"[^/\\.\s][^/\\]*"), 120
_PERIODIC = ("harmonic", "constant")
# Signals that each kind of analysis understands beside numbers.
_SIGNALS = {
    "static": (),
    "periodic": _PERIODIC,
    "frequency_response": ("constant",),
    "load_response": _PERIODIC,
    "locus": ("constant",),
    "basins": _PERIODIC,
    "swept_response": ("constant",),
    "modulation": ("constant",),
    "quasi_periodic": _PERIODIC,
    "quasi_periodic_response": ("constant",),
}


def contradictions(case: Any, folder: str) -> list[Problem]:
    """Problems of tables that are valid each by itself.

    Parameters
    ----------
    case : CaseTables
    folder : str
        Folder that paths in the case are relative to.
    """
    return [
        *_geometry(case, folder),
        *_materials(case),
        *_model(case),
        *_loads(case, folder),
        *_analyses(case),
        *_sweep(case),
    ]


def _geometry(case: Any, folder: str) -> Iterator[Problem]:
    kind = case.geometry.kind
    for key in sorted(case.mesh.model_fields_set):
        if key not in MESH_KEYS[kind]:
            yield Problem(("mesh", key), f"is not for geometry.kind = {kind!r}; {one_of(MESH_KEYS[kind])}")
    if kind == "gmsh":
        path = os.path.join(folder, case.geometry.file)
        if not os.path.isfile(path):
            yield Problem(
                ("geometry", "file"),
                f"= {case.geometry.file!r} does not exist in {folder!r}; name a gmsh model "
                "relative to the case "
                "file",
            )
        if case.points:
            yield Problem(
                ("points",),
                "is not for a gmsh model, whose named points are its physical points; add them there",
            )


def _materials(case: Any) -> Iterator[Problem]:
    if case.material is not None and case.materials:
        yield Problem(
            ("materials",),
            "stands beside [material]; give one material for the whole body or one a region, not both",
        )
    if case.material is None and not case.materials:
        yield Problem(("material",), "is missing; add [material] with young, poisson and density")
    found: list[tuple[Path, Any]] = [(("material",), case.material)] if case.material is not None else []
    found += [(("materials", name), material) for name, material in case.materials.items()]
    for path, material in found:
        if material.kind == "isotropic" and material.plane == "strain" and material.poisson >= 0.5:
            yield Problem((*path, "poisson"), f"= {material.poisson:g} must be below 0.5 in plane strain")


def _model(case: Any) -> Iterator[Problem]:
    model = case.model
    if model.clamped is None and not model.supports and case.geometry.kind != "beam":
        yield Problem(
            ("model", "clamped"),
            f"is missing, which only a beam has a default for; name an edge set of the "
            f"{case.geometry.kind}, or "
            "write clamped = [] for a free structure",
        )
    free = model.clamped == [] and not model.supports
    for name, analysis in case.analyses.items():
        if free and analysis.kind != "modal":
            yield Problem(
                ("analyses", name, "kind"),
                f"= {analysis.kind!r} needs a structure held against every rigid-body motion, but "
                "model.clamped "
                "= [] and there are no supports; clamp an edge set",
            )
    rayleigh = model.rayleigh
    if isinstance(rayleigh, list):
        for k, value in enumerate(rayleigh):
            if value < 0.0:
                yield Problem(("model", "rayleigh", k), f"= {value:g} must not be negative")
    elif rayleigh is not None and rayleigh.low >= rayleigh.high:
        yield Problem(
            ("model", "rayleigh", "low"), f"= {rayleigh.low:g} must be below high = {rayleigh.high:g}, in Hz"
        )


def _loads(case: Any, folder: str) -> Iterator[Problem]:
    for name, load in case.loads.items():
        given = {key: getattr(load, key) for key in COMPONENTS if key in type(load).model_fields}
        if all(value == 0.0 for value in given.values()):
            yield Problem(("loads", name), f"has no component other than 0; give {' or '.join(given)}")
        for key, value in given.items():
            path: Path = ("loads", name, key)
            kind = getattr(value, "kind", None)
            if kind == "samples" and not os.path.isfile(os.path.join(folder, value.file)):
                yield Problem(
                    (*path, "file"),
                    f"= {value.file!r} does not exist in {folder!r}; name a file relative to the case file",
                )
            if kind == "chirp" and value.taper > 0.5 * value.duration:
                yield Problem(
                    (*path, "taper"),
                    f"= {value.taper:g} must be at most half the duration, {0.5 * value.duration:g}, in s",
                )
            if kind == "chirp" and value.start == value.stop == 0.0:
                yield Problem((*path, "stop"), "= 0 and start = 0 leave no oscillation; one must be positive")


def _filed(name: str) -> bool:
    """Whether files can bear a name."""
    return bool(_FILED.fullmatch(name)) and name.isprintable() and len(name.encode()) <= _LONGEST


def _analyses(case: Any) -> Iterator[Problem]:
    for name, analysis in case.analyses.items():
        path: Path = ("analyses", name)
        if name in RESERVED or not _filed(name):
            yield Problem(
                path, "cannot be a name of an analysis; use letters, digits, '-' and '_', at most 100 of them"
            )
        for place in getattr(analysis, "stress_at", {}):
            if not _filed(place):
                yield Problem(
                    (*path, "stress_at", place),
                    "cannot be a name of a place; use letters, digits, '-' and '_', at most 100 of them",
                )
        yield from _analysis_loads(case, path, analysis)
        for key, text in analysis.contradictions():
            yield Problem((*path, key) if key else path, text)
        if analysis.kind == "locus":
            yield from _locus(case, path, analysis)
        if analysis.kind == "load_history":
            yield from _range((*path, "times"), analysis.times)
        if analysis.kind == "basins":
            if analysis.factor == 0.0:
                yield Problem((*path, "factor"), "= 0 leaves no load; give another factor")
            for k, axis in enumerate(analysis.starts):
                yield from _axis((*path, "starts", k), axis)
                if axis.kind != "impulse" and analysis.modes is not None and axis.mode > analysis.modes:
                    yield Problem(
                        (*path, "starts", k, "mode"),
                        f"= {axis.mode} must be one of the modes = {analysis.modes}",
                    )


def _locus(case: Any, path: Path, analysis: Any) -> Iterator[Problem]:
    """A factor on damping that there is none of."""
    undamped = case.model.damping == 0.0 and case.model.rayleigh is None
    if analysis.parameter == "damping" and undamped:
        yield Problem(
            (*path, "parameter"),
            '= "damping" has no effect without damping; give model.damping, or another parameter',
        )


def _range(path: Path, values: Any) -> Iterator[Problem]:
    """A range without a number of values, or one that has no logarithm."""
    if isinstance(values, list):
        return
    if values.count is None:
        yield Problem((*path, "count"), "is missing (number of values); add it")
    if values.scale == "logarithmic" and not min(values.start, values.stop) > 0.0:
        yield Problem((*path, "scale"), '= "logarithmic" needs start and stop greater than 0')


def _axis(path: Path, axis: Any) -> Iterator[Problem]:
    """Values of an axis of initial states that do not rise, and a point that an impulse has not."""
    values = axis.values
    yield from _range((*path, "values"), values)
    listed = values if isinstance(values, list) else [values.start, values.stop][: values.count]
    if any(after <= before for before, after in zip(listed, listed[1:])):
        yield Problem((*path, "values"), f"= {listed} must rise")
    if axis.kind == "impulse" and axis.point is not None:
        yield Problem((*path, "point"), f"= {axis.point!r} has no meaning for an impulse; leave it out")


def _analysis_loads(case: Any, path: Path, analysis: Any) -> Iterator[Problem]:
    """Names of loads that do not exist, and signals that an analysis does not understand."""
    for key in ("load", "pump", "probe"):
        names = getattr(analysis, key, None) or []
        for name in names:
            if name not in case.loads:
                yield Problem((*path, key), f"= {name!r} is no load; {one_of(case.loads, name)}")
                continue
            allowed = _SIGNALS.get(analysis.kind)
            if allowed is None:
                continue
            load = case.loads[name]
            for component in COMPONENTS:
                kind = getattr(getattr(load, component, None), "kind", None)
                if kind is not None and kind not in allowed:
                    what = f"numbers and {' or '.join(allowed)}" if allowed else "numbers"
                    yield Problem(
                        (*path, key),
                        f"= {name!r} has {component} of kind {kind!r}, but {analysis.kind} takes {what}; use "
                        "transient, or another load",
                    )
        if "harmonic" in _SIGNALS.get(analysis.kind, ()):
            yield from _ambiguous(case, (*path, key), [name for name in names if name in case.loads])


def _ambiguous(case: Any, path: Path, names: Sequence[str]) -> Iterator[Problem]:
    """A number beside signals that vary, where numbers are amplitudes: it may be meant as a constant."""
    named = [(name, part, getattr(case.loads[name], part, 0.0)) for name in names for part in COMPONENTS]
    if all(getattr(value, "kind", "constant") == "constant" for _, _, value in named):
        return
    for name, part, value in named:
        if isinstance(value, float) and value != 0.0:
            yield Problem(
                path,
                f"= {name!r} has {part} = {value:g}, a number beside signals, which may be meant as a "
                f'constant or as an amplitude; give {{ kind = "constant", value = {value:g} }} or {{ kind = '
                f'"harmonic", amplitude = {value:g}, frequency = ... }}',
            )


def _sweep(case: Any) -> Iterator[Problem]:
    sweep = case.sweep
    if sweep is None:
        return
    path: Path = ("sweep",)
    for name in sweep.analyses or ():
        if name not in case.analyses:
            yield Problem((*path, "analyses"), f"= {name!r} is no analysis; {one_of(case.analyses, name)}")
    latin = sweep.method == "latin_hypercube"
    if latin and sweep.samples is None:
        yield Problem(
            (*path, "samples"), 'is missing; method = "latin_hypercube" needs the number of samples'
        )
    if not latin and sweep.samples is not None:
        yield Problem((*path, "samples"), 'is for method = "latin_hypercube"; leave it out or change method')
    lengths = {}
    for name, values in sweep.parameters.items():
        here: Path = (*path, "parameters", name)
        if isinstance(values, list):
            lengths[name] = len(values)
            if latin:
                yield Problem(here, 'must be { start, stop } with method = "latin_hypercube"')
            continue
        lengths[name] = values.count or 0
        if latin and values.count is not None:
            yield Problem((*here, "count"), 'is not for method = "latin_hypercube"; give sweep.samples')
        if not latin and values.count is None:
            yield Problem((*here, "count"), "is missing (number of values); add it")
        if values.scale == "logarithmic" and not (values.start > 0.0 and values.stop > 0.0):
            yield Problem((*here, "scale"), '= "logarithmic" needs start and stop greater than 0')
    if sweep.method == "grid" and math.prod(lengths.values()) > MOST:
        yield Problem(
            (*path, "parameters"),
            f"make {math.prod(lengths.values()):,d} rows, more than {MOST:,d}; give fewer values, or samples "
            'with method = "latin_hypercube"',
        )
    if sweep.method == "list" and len(set(lengths.values())) > 1:
        listed = ", ".join(f"{name}: {count}" for name, count in lengths.items())
        yield Problem(
            (*path, "parameters"), f'must have equally many values each with method = "list" ({listed})'
        )
