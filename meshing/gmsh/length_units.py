"""Units of length: what a CAD file says, what gmsh makes of it, what the user says."""

from __future__ import annotations

import re
from dataclasses import dataclass

from meshing.gmsh.files import IGES, STEP

_SI = dict(
    EXA=1e18, PETA=1e15, TERA=1e12, GIGA=1e9, MEGA=1e6, KILO=1e3, HECTO=1e2, DECA=1e1, DECI=1e-1, CENTI=1e-2,
    MILLI=1e-3, MICRO=1e-6, NANO=1e-9, PICO=1e-12, FEMTO=1e-15, ATTO=1e-18,
)  # fmt: skip
# IGES 5.3, section 2.2.4.3.14
_IGES = {
    1: 0.0254, 2: 1e-3, 4: 0.3048, 5: 1609.344, 6: 1.0, 7: 1e3, 8: 2.54e-5, 9: 1e-6, 10: 1e-2, 11: 2.54e-8,
}  # fmt: skip
_FLAG = 13  # place of the unit's flag among the global parameters


@dataclass(frozen=True)
class Units:
    """Of a user's model.

    Attributes
    ----------
    factor : float
        m of what gmsh, or the reader of another format, hands over as 1.
    file : float or None
        Length of the file's own unit, m; None where it says none.
    scale : float or None
        The user's.
    """

    factor: float
    file: float | None
    scale: float | None

    @classmethod
    def of(cls, ending: str, content: bytes, scale: float | None, origin: str) -> Units:
        """Those of a checked file; `ending` in small letters.

        Raises
        ------
        ValueError
            If `scale` is given for a CAD file whose own unit is not understood.
        """
        if ending not in STEP + IGES:
            return cls(1.0 if scale is None else scale, None, scale)
        unit = step_unit(content) if ending in STEP else iges_unit(content)
        if scale is not None and unit is None:
            raise ValueError(
                f"{origin}: its unit of length is not understood, so scale = {scale:g} has no meaning; leave "
                "scale out."
            )
        # gmsh hands a step file over in m, OpenCASCADE an iges file in mm, whatever the file's unit
        factor = 1.0 if ending in STEP else 1e-3
        if scale is not None and unit is not None:
            factor *= scale / unit
        return cls(factor, unit, scale)


def step_unit(content: bytes) -> float | None:
    """Length of a STEP file's unit, m; None if it says none, or several.

    Parameters
    ----------
    content : bytes
        Of the whole file.
    """
    text = content.decode("latin-1")
    statements = dict(re.findall(r"#(\d+)\s*=\s*([^;]*);", text))
    lengths = {number for number, statement in statements.items() if "LENGTH_UNIT" in statement}
    contexts = re.findall(r"GLOBAL_UNIT_ASSIGNED_CONTEXT\s*\(\s*\(([^)]*)\)", text)
    used = {number for inside in contexts for number in re.findall(r"#(\d+)", inside)}
    found = {_step_length(statements, number, 3) for number in used & lengths}
    return found.pop() if len(found) == 1 else None


def _step_length(statements: dict[str, str], number: str, deep: int) -> float | None:
    """Length of one unit, m: an SI unit, or a multiple of another."""
    statement = statements.get(number, "")
    si = re.search(r"SI_UNIT\s*\(\s*(?:\$|\.(\w+)\.)\s*,\s*\.METRE\.\s*\)", statement)
    if si:
        return _SI.get(si[1]) if si[1] else 1.0
    other = re.search(r"CONVERSION_BASED_UNIT\s*\(\s*'[^']*'\s*,\s*#(\d+)\s*\)", statement)
    said = statements.get(other[1], "") if other else ""
    measure = re.search(r"MEASURE\s*\(\s*(\d+\.?\d*(?:E[-+]?\d+)?)\s*\)\s*,\s*#(\d+)", said)
    base = _step_length(statements, measure[2], deep - 1) if measure and deep else None
    return float(measure[1]) * base if measure and base else None


def iges_unit(content: bytes) -> float | None:
    """Length of an IGES file's unit, m; None if it is none of the known ones.

    Parameters
    ----------
    content : bytes
        Of the whole file.
    """
    lines = [line for line in content.decode("latin-1").splitlines() if line[72:73] == "G"]
    rest = "".join(line[:72] for line in lines)
    between = rest[2] if rest.startswith("1H") else ","
    values: list[str] = []
    while rest and len(values) <= _FLAG:
        text = re.match(r"\s*(\d+)H", rest)  # a string after its length
        end = rest.find(between, text.end() + int(text[1]) if text else 0)
        values.append(rest[: end if end >= 0 else None].strip())
        rest = rest[end + 1 :] if end >= 0 else ""
    flag = values[_FLAG] if len(values) > _FLAG else ""
    return _IGES.get(int(flag)) if flag.isdigit() else None
