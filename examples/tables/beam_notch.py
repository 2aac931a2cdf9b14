"""Tables of beam_notch.py: frequencies and static contact beside the reference and the paper's columns."""

import json
import pathlib

from rich.table import Table

REFERENCE = pathlib.Path(__file__).resolve().parents[1] / "reference" / "reference.json"


def frequency_table(found):
    """Frequencies beside the converged reference and the paper's columns, Hz; errors relative to the
    reference.
    """
    reference = json.loads(REFERENCE.read_text())
    exact = reference["modes"]["crack80_nu33"]["frequency_Hz"]
    table = Table(title="Natural frequencies, Hz (open crack)")
    for name in (
        "mode",
        "sbfem-petsc",
        "reference",
        "error",
        "paper p = 5",
        "paper p = 7",
        "paper p = 9",
        "paper FEM",
    ):
        table.add_column(name, justify="right")
    for i, frequency in enumerate(found):
        printed = reference["paper"]["T6"].get(str(i + 1), {})
        columns = [f"{printed[c]:.6g}" if c in printed else "" for c in ("p5", "p7", "p9", "FEM")]
        table.add_row(
            str(i + 1), f"{frequency:.4f}", f"{exact[i]:.4f}", f"{frequency / exact[i] - 1:+.1e}", *columns
        )
    largest = max(abs(f / e - 1) for f, e in zip(found, exact))
    table.caption = f"largest relative error of frequencies 1-{len(found)}: {largest:.2e}"
    return table


def static_table(pushes):
    """Displacements and contact resultants beside the converged reference and the paper's columns."""
    reference = json.loads(REFERENCE.read_text())
    exact = reference["static"]["x80_mouth2um_nu33"]["contact"]
    table = Table(
        title="Static contact, force at A in +y",
        caption="paper columns at 100 N: one pass ties every penetrating pair (u at p = 5); FEM: unilateral "
        "contact; at the tip: contact over less than its S-element resolves, see unresolved_contact",
    )
    for name in ("force", "quantity", "sbfem-petsc", "reference", "error", "paper p = 5", "paper FEM"):
        table.add_column(name, justify="right")
    for name, push in pushes.items():
        paper = {
            ("A", 1): f"T{3 if name == '1 N' else 5}_uy_{name.replace(' ', '')}",
            ("B", 0): f"T{2 if name == '1 N' else 4}_ux_{name.replace(' ', '')}",
        }
        paper["C", 0] = paper["B", 0]
        for point, axis in (("A", 1), ("B", 0), ("C", 0)):
            value = push.displacement(point)[axis]
            truth = exact[name]["u"][point]["uy" if axis else "ux"]
            printed = reference["paper"].get(paper[point, axis], {})
            columns = [f"{printed[c]['ABC'.index(point)]:.5g}" if printed else "" for c in ("p5", "FEM")]
            table.add_row(
                name,
                f"u_{'xy'[axis]}({point}), m",
                f"{value:.6e}",
                f"{truth:.6e}",
                f"{value / truth - 1:+.1e}",
                *columns,
            )
        truth = exact[name]["cracks"][0]["resultant"]
        # what touches over less than the tip's S-element sees is told beside what the pairs carry
        missed = sum(push.unresolved_contact.values())
        seen = missed < 0.02 * push.contact_resultant
        table.add_row(
            name,
            "contact resultant, N",
            f"{push.contact_resultant:.1f}"
            if seen
            else f"{push.contact_resultant:.1f} + {missed:.1f} at the tip",
            f"{truth:.1f}",
            f"{push.contact_resultant / truth - 1:+.1e}" if seen else "tip too large",
            "",
            "",
            end_section=True,
        )
    return table


def print_tables(out, modes, pushes, *, tip_element):
    """Print all; stress intensity factors where the crack ends in an S-element."""
    out.print(frequency_table(modes.frequencies))
    out.print(
        f"{modes.solver}: {modes.iterations} iteration(s), {modes.unknowns} unknowns, largest residual "
        f"{modes.residuals.max():.1e}\n"
    )
    out.print(static_table(pushes))
    for name, push in pushes.items() if tip_element else ():
        if push.stress_intensity:
            opening, sliding = push.stress_intensity["crack1"]
            out.print(
                f"{name}: K_I = {opening / 1e6:.5g}, K_II = {sliding / 1e6:.3g} MPa m^1/2; "
                f"{int(push.active.sum())} of {len(push.gap)} pairs in contact, {push.iterations} "
                f"iteration(s), {push.solver}; not resolved next to the tip: "
                f"{sum(push.unresolved_contact.values()):.3g} N"
            )
