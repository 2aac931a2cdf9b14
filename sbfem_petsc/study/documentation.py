"""Reference of the case file, its JSON Schema, words of the analyses and what results hold, made from the
classes themselves.

python -m sbfem_petsc.study.documentation     writes docs/case_file.md, its schema, docs/words.md and
                                              docs/results.md
"""

from __future__ import annotations

import inspect
import json
import pathlib
import re
import types
import typing
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

import sbfem_petsc as sb

from ..options import unit_of
from ..record.body import Body
from ..record.record import Entry, Record, entries, record_class
from .case.analyses import KINDS
from .case.body import BODIES, BodyContact, BodyPoint
from .case.case import CaseTables
from .case.geometry import (
    GEOMETRIES,
    BeamGeometry,
    CrackLine,
    DampingByFrequency,
    GmshGeometry,
    Hole,
    Isotropic,
    Mesh,
    ModelTable,
    Notch,
    Orthotropic,
    PlateGeometry,
    RayleighBand,
    Support,
)
from .case.given import Output
from .case.laws import LAWS
from .case.loads import EdgeLoad, EdgeMotion, Force, PointForce, SupportMotion
from .case.signals import SIGNALS
from .case.sweep import Noise, Range, SweepTable
from .case.tables import kind_name
from .kinds.basins import StartAxis

_HEAD = """# The case file

A case file describes a structure, its loads and the analyses that are wanted, in [TOML](https://toml.io):
tables in brackets, `key = value`, comments after `#`. `sbfem new beam case.toml` writes a commented one
(`plate`, `gmsh`, `body`, `modulation`, `nonlinear` and `sweep` are others), `sbfem check case.toml` checks
it, `sbfem run case.toml --output DIR` runs it. Lengths are in m, all units are SI, angles are in degrees.
Keys without a default have to be given. This page is generated from the program's own tables;
[`case_file.schema.json`](case_file.schema.json) lets an editor check and complete a case file.
"""
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


_WORDS = """# Words of the analyses

One word means one thing in all analyses, in Python and in a case file; where it is about another quantity it
has a line for each. This page is generated from the classes of options (`sbfem_petsc/analysis/options.py`),
which check them.

"""
# Arguments that are no options: of a call, not of what is computed.
_ARGUMENTS = {
    "guess": "a motion that an iteration or a curve begins from",
    "initial": "the state of a history at t = 0",
    "file": "HDF5 file that is kept up to date while it runs",
    "resume": "true: go on from `file` if it exists",
    "progress": 'a function that is told the fraction done, "auto": a bar, or nothing',
    "reduction": "nothing: the unreduced model",
}


_RESULTS = """# Results: hold, save, read, plot, export

In Python, and of a case whose results are in a folder `DIR`:

- **See** what it is: `print(result)`, or its name at the end of a notebook's cell; `sbfem info DIR`.
- **Hold** numbers: the attributes below, `result.displacement("A")`, of many results at any (x, y) too; of a
  case `sb.read(DIR).value("push", "displacement", "A")`, of a [sweep](sweeps.md)
  `sb.read(DIR).values["steady/A2_A1/A"]`, and `summary.json`; histories, motions and curves of a case are
  files in `DIR/analyses` for `sb.read`.
- **Save and read**: `sb.save(path, result)` writes any of these, or a list or dict of them, `sb.read(path)`
  gives it back. Histories, curves and loci are kept while they run with `file=path`, and go on from there
  with `resume=True`; a case goes on by the same command.
- **Tables**: `result.to_csv(path)`, one for each axis, `result.to_xarray()`; `csv = true` or
  `sbfem export DIR --csv`.
- **Plot**: `plot_...` of [sbfem_petsc.plot](reference/plot.md), `save_picture(axes, path)`; `sbfem plot DIR`.
- **Fields in ParaView**: `sb.write_vtu`, `sb.write_modes`, `sb.write_animation`; `vtu = true` or
  `sbfem export DIR --vtu`.
- **A report** of a case, one HTML file: `sbfem report DIR`.

Other programs open the file as it is, xarray by `xarray.open_datatree(path)` (complex numbers come as pairs
`r`, `i`, or with `auto_complex=True` as such), h5py, MATLAB and Octave (`ncread` of its package netcdf, which
reads numbers alone) by the names below, and `pandas.read_csv` what `result.to_csv(path)` writes:

```python
import h5py
import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.plot import plot_field, plot_harmonics, save_picture

mesh = Beam(0.1, 0.01, [VNotch(0.04, 0.004, 0.02)]).mesh()
model = sb.Model(mesh, sb.Material(70e9, 0.33, 2700.0), damping=0.01)
push = sb.static(model, sb.PointForce("A", fy=100.0))
orbit = sb.periodic(model, sb.PointForce("A", fy=300.0), 1000.0, modes=12, steps=64)
print(push.reactions["left"][1], push.contact_resultant)  # N
print(orbit.stable, orbit.amplitude("A"))  # m

sb.save("both.h5", {"push": push, "orbit": orbit})
both = sb.read("both.h5")
with h5py.File("both.h5") as file:
    force = file["push/contact_force"][:]  # N
print(both["orbit"].to_csv("orbit.csv"))  # the tables that it has made
save_picture(plot_harmonics(both["orbit"], "A"), "harmonics.png")
save_picture(plot_field(model, {"push": push}), "stress.png")
sb.write_vtu("stress.vtu", model, {"push": push, "orbit at 0.2 ms": orbit.field(2e-4)})
```

```text
-99.99999999777934 105.11232720796397
True 2.6772487068344354e-05
['orbit.csv', 'orbit_values.csv', 'orbit_iterate.csv', 'orbit_multiplier.csv', 'orbit_note.csv', ...]
```

Each name is an attribute in Python and, where another one stands behind it, that one in files and tables.

- **file**: a data set with `units`, `long_name` and the axes named here as its dimensions, a text as an
  attribute, a result inside this one as a group (several of them as groups `0000`, `0001` and so on). The
  axis `*` is that of the result that the part is in. Fields of the nodes have [Body](#body) beside them.
- **table**: a column, with the unit in its head, in the table of the first axis; without an axis a line of
  `..._values.csv`.
- **sweep**: a column of the table of a sweep.

This page is generated from the classes of results, which write and read the files, too.

"""


def results() -> str:
    """The page of results: what each class holds, and the parts of it."""
    public = {name: getattr(sb, name) for name in sorted(sb.__all__)}
    kinds = [kind for kind in public.values() if isinstance(kind, type) and issubclass(kind, Record)] + [Body]
    for kind in kinds:  # grows by those of the parts
        for entry in entries(kind).values():
            parts = map(record_class, entry.about.part.split())
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
        lines += [_result_line(entry) for entry in entries(kind).values()]
        sections.append("\n".join(lines) + "\n")
    return _RESULTS + "\n".join(sections)


def _result_line(entry: Entry) -> str:
    about = entry.about
    if about.part:
        kind = " or ".join(f"[{part}](#{part.lower()})" for part in about.part.split())
        kind = f"several {kind}" if entry.type.startswith("tuple") else kind
    else:
        kind = ", ".join(about.dims) or entry.type.removesuffix(" | None")
    where = {
        "file": about.stored,
        "table": not (about.detail or about.part or about.distributed),
        "sweep": about.row,
    }
    cells = (
        f"`{entry.name}`" + (f" (`{entry.called}`)" if entry.called != entry.name else ""),
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
    return _WORDS + "\n".join(lines) + "\n"


def markdown() -> str:
    """The reference page."""
    parts = [_HEAD]
    parts.append("## Top level\n\n" + _table(CaseTables, skip=("sweep",)))
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


def main() -> None:
    """Write the files into the folder docs of the working directory."""
    folder = pathlib.Path("docs")
    for name, made in PAGES.items():
        (folder / name).write_text(made(), encoding="utf-8")


if __name__ == "__main__":
    main()
