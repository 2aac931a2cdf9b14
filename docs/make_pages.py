"""Reference of the case file, its JSON Schema, words of the analyses and what results hold, made from the
classes themselves.

python docs/make_pages.py     writes docs/case_file.md, its schema, docs/words.md and docs/results.md
"""

from __future__ import annotations

import inspect
import json
import pathlib
import re
import sys
import types
import typing
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

import sbfem_petsc as sb
from sbfem_petsc.options import unit_of
from sbfem_petsc.record.about import About
from sbfem_petsc.record.record import Record, entries, record_class
from sbfem_petsc.study.case.analyses import KINDS
from sbfem_petsc.study.case.body import BODIES, BodyContact, BodyPoint
from sbfem_petsc.study.case.case_tables import CaseTables, Output
from sbfem_petsc.study.case.geometry import (
    GEOMETRIES,
    BeamGeometry,
    DampingByFrequency,
    GmshGeometry,
    Mesh,
    ModelTable,
    PlateGeometry,
    RayleighBand,
)
from sbfem_petsc.study.case.parts import (
    LAWS,
    SIGNALS,
    CrackLine,
    EdgeLoad,
    EdgeMotion,
    Force,
    Hole,
    Isotropic,
    Notch,
    Orthotropic,
    PointForce,
    Support,
    SupportMotion,
)
from sbfem_petsc.study.case.sweep import Noise, Range, SweepTable
from sbfem_petsc.study.case.tables import kind_name
from sbfem_petsc.study.kinds.basins import StartAxis
from sbfem_petsc.system.body import Body

_SECTIONS: tuple[tuple[str, str, tuple[type[BaseModel], ...]], ...] = (
    (
        "[geometry]",
        "One of three kinds, or [body].",
        (BeamGeometry, Notch, Hole, PlateGeometry, CrackLine, GmshGeometry),
    ),
    (
        "[body]",
        "A [body of another code](bodies.md) in the place of `[geometry]`, `[mesh]`, `[points]` and "
        "`[material]`; of `[model]` it takes `damping` and `rayleigh`. Its matrices are not kept in results.",
        (*BODIES, BodyContact, BodyPoint),
    ),
    ("[mesh]", "", (Mesh,)),
    (
        "[material] or [materials.REGION]",
        "One `[material]` for the whole body, or one table for each region of the mesh (the "
        "physical surfaces of a "
        "gmsh model).",
        (Isotropic, Orthotropic),
    ),
    ("[model]", "", (ModelTable, Support, *LAWS, DampingByFrequency, RayleighBand)),
    (
        "[loads.NAME]",
        'A component is a number or a table with a signal, `fy = { kind = "harmonic", amplitude = '
        "1.0, frequency = "
        "50.0 }`. What a number means depends on the analysis: a constant force in `static`, "
        "`load_history` and `transient`, the "
        "amplitude of sin(2 pi f t) in `periodic`, `frequency_response`, `load_response`, `modulation`, "
        "`quasi_periodic` and `quasi_periodic_response`. Beside a signal that varies these refuse a number, "
        "which may be meant as either: a table of kind constant or harmonic says which.",
        (PointForce, EdgeLoad, SupportMotion, EdgeMotion, Force, *SIGNALS),
    ),
    (
        "[analyses.NAME]",
        "The names are yours; analyses run in the order of the file.",
        (*KINDS.values(), StartAxis),
    ),
    ("[output]", "", (Output,)),
    (
        "[sweep]",
        "Run by `sbfem sweep`. Parameters are dotted paths into the case; `[0]` is the first entry "
        "of an array.",
        (SweepTable, Range, Noise),
    ),
)


# Arguments that are no options: of a call, not of what is computed.
_ARGUMENTS = {
    "guess": "a motion that an iteration or a curve begins from",
    "initial": "the state of a history at t = 0",
    "file": "HDF5 file that is kept up to date while it runs",
    "resume": "true: go on from `file` if it exists",
    "progress": 'a function that is told the fraction done, "auto": a bar, or nothing',
    "reduction": "nothing: the unreduced model",
}


def results() -> str:
    """The page of results: what each class holds, and the parts of it."""
    public = {name: getattr(sb, name) for name in sorted(sb.__all__)}
    kinds = [kind for kind in public.values() if isinstance(kind, type) and issubclass(kind, Record)] + [Body]
    for kind in kinds:  # grows by those of the parts
        for about in entries(kind).values():
            parts = map(record_class, about.part.split())
            kinds += [part for part in parts if part not in kinds]
    sections = []
    for kind in kinds:
        name = kind.__name__
        makers = [
            f"`{maker}`"
            for maker, function in public.items()
            if inspect.isfunction(function)
            and re.search(rf"\b{name}\b", str(function.__annotations__.get("return")))
        ]
        first = " ".join((kind.__doc__ or "").split("Attributes\n")[0].split("\n\n")[0].split())
        lines = [f"## {name}\n", first + (f" Of {', '.join(makers)}." if makers else "") + "\n"]
        lines += ["| name | type or axes | unit | meaning | in |", "|---|---|---|---|---|"]
        lines += map(_result_line, entries(kind).values())
        sections.append("\n".join(lines) + "\n")
    return "\n".join(sections)


def _result_line(about: About) -> str:
    if about.part:
        kind = " or ".join(f"[{part}](#{part.lower()})" for part in about.part.split())
        kind = f"several {kind}" if about.type.startswith("tuple") else kind
    else:
        kind = ", ".join(about.dims) or about.type.removesuffix(" | None")
    where = {
        "file": about.stored,
        "table": not (about.detail or about.part or about.distributed),
        "sweep": about.row,
    }
    cells = (
        f"`{about.name}`" + (f" (`{about.called}`)" if about.called != about.name else ""),
        kind,
        "of its value" if about.unit_of else "" if about.part else about.unit,
        about.text,
        ", ".join(place for place, there in where.items() if there),
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def words() -> str:
    """The page of words: what each means, and in which functions it stands."""
    found: dict[str, dict[tuple[str, str], list[str]]] = {}
    for name in sorted(sb.__all__):
        function = getattr(sb, name)
        if not hasattr(function, "options"):
            continue
        fields, given = function.options.model_fields, inspect.signature(function).parameters
        meanings = {option: (str(field.description), unit_of(field)) for option, field in fields.items()}
        meanings |= {word: (text, "") for word, text in _ARGUMENTS.items() if word in given}
        for word, meaning in meanings.items():
            found.setdefault(word, {}).setdefault(meaning, []).append(name)
    lines = ["| word | meaning | unit | in |", "|---|---|---|---|"]
    for word, under in sorted(found.items()):
        for (text, unit), names in under.items():
            listed = ", ".join(f"`{name}`" for name in names)
            lines.append(f"| `{word}` | {text} | {unit} | {listed} |")
    return "\n".join(lines) + "\n"


def markdown() -> str:
    """The reference page."""
    parts = ["## Top level\n\n" + _table(CaseTables, skip=("sweep",))]
    for heading, text, tables in _SECTIONS:
        parts.append(f"## `{heading}`\n\n{text}".rstrip() + "\n")
        for table in tables:
            if len(tables) > 1:
                parts.append(f"### {_title(table)}\n")
            parts.append(" ".join((table.__doc__ or "").split()) + "\n")
            parts.append(_table(table))
            if table is Mesh:
                known = "; ".join(
                    f"`{kind_name(kind)}`: {', '.join(f'`{key}`' for key in kind.mesh_keys())}"
                    for kind in GEOMETRIES
                )
                parts.append(f"Keys by kind of geometry: {known}.\n")
    return "\n".join(parts)


def schema() -> str:
    """JSON Schema of a case file."""
    found = CaseTables.model_json_schema(mode="validation")
    found["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    found["title"] = "sbfem-petsc case file"
    return json.dumps(found, indent=1) + "\n"


def _title(table: type[BaseModel]) -> str:
    field = table.model_fields.get("kind")
    if field is not None and table is not StartAxis:
        return f'`kind = "{typing.get_args(field.annotation)[0]}"`'
    return {
        "Notch": "`[[geometry.notches]]`",
        "Hole": "`[[geometry.holes]]` (beam, plate)",
        "CrackLine": "`[[geometry.cracks]]` (plate)",
        "Support": "`[[model.supports]]`",
        "DampingByFrequency": "`damping = { ... }`",
        "RayleighBand": "`rayleigh = { ... }`",
        "Range": "A range of values",
        "Noise": "`noise = { ... }`",
        "ModelTable": "`[model]`",
        "SweepTable": "`[sweep]`",
        "BodyContact": "`[[body.contacts]]`",
        "BodyPoint": "`[body.points.NAME]`",
        "StartAxis": "`starts = [{ ... }, ...]` of basins",
    }[table.__name__]


def _table(table: type[BaseModel], skip: tuple[str, ...] = ()) -> str:
    lines = ["| key | type | unit | default | meaning |", "|---|---|---|---|---|"]
    for name, field in sorted(table.model_fields.items(), key=lambda entry: entry[0] != "kind"):
        if name in skip:
            continue
        extra = field.json_schema_extra
        unit = str(extra.get("unit", "")) if isinstance(extra, dict) else ""
        cells = (
            f"`{name}`",
            _kind(field.annotation, field.metadata),
            unit,
            _default(field),
            _bounded(field),
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(lines) + "\n"


def _default(field: Any) -> str:
    if field.is_required():
        return "**needed**"
    if field.default is None or isinstance(field.default, BaseModel):
        return ""
    if field.default is PydanticUndefined:
        return ""
    return f"`{json.dumps(field.default)}`"


def _bounded(field: Any) -> str:
    words = {"gt": "above", "ge": "at least", "lt": "below", "le": "at most"}
    bounds = [
        f"{text} {getattr(entry, name):g}"
        for entry in field.metadata
        for name, text in words.items()
        if getattr(entry, name, None) is not None
    ]
    return (field.description or "") + (f" ({', '.join(bounds)})" if bounds else "")


def _kind(annotation: Any, metadata: Any) -> str:
    if metadata:
        annotation = Annotated[(annotation, *metadata)]
    return " or ".join(dict.fromkeys(_kinds(annotation)))


def _kinds(annotation: Any) -> Iterator[str]:
    origin, parts = typing.get_origin(annotation), typing.get_args(annotation)
    names = {float: "number", int: "whole number", bool: "true or false", str: "text", Any: "any"}
    if annotation is type(None):
        return
    if origin is Annotated:
        if any(getattr(entry, "json_schema_input_type", None) == (str | list[str]) for entry in parts[1:]):
            yield "text"
        yield from _kinds(parts[0])
    elif origin in (typing.Union, types.UnionType):
        for part in parts:
            yield from _kinds(part)
    elif origin is typing.Literal:
        yield ", ".join(json.dumps(part) for part in parts)
    elif origin is list:
        inner = " or ".join(dict.fromkeys(_kinds(parts[0])))
        yield f"array of {inner}"
    elif origin is dict:
        inner = " or ".join(dict.fromkeys(_kinds(parts[1])))
        yield f"table of {inner}" if inner != "table" else "tables by name"
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield "table"
    else:
        yield names[annotation]


PAGES = {"results.md": results, "words.md": words, "case_file.md": markdown, "case_file.schema.json": schema}
MARK = "<!-- Made by python docs/make_pages.py from here on -->\n\n"


def page(path: pathlib.Path) -> str:
    """A file of `PAGES` as it is to be: what a person has written, up to the mark, stays."""
    made = PAGES[path.name]()
    return made if path.suffix == ".json" else path.read_text(encoding="utf-8").split(MARK)[0] + MARK + made


def main() -> None:
    """Write the files beside this one anew."""
    for path in (pathlib.Path(__file__).with_name(name) for name in PAGES):
        path.write_text(page(path), encoding="utf-8")


if __name__ == "__main__":
    main()
