"""Case P, tone bursts on it, and what tone_burst.py prints, writes and draws beside the reference."""

import json
import os
import pathlib

import numpy as np
from rich.table import Table

import sbfem_petsc as sb
from meshing import Beam, VNotch
from sbfem_petsc.plot import Panel, plot_histories, save_pictures
from sbfem_petsc.writing import write_table

FOLDER = pathlib.Path(__file__).resolve().parents[1] / "reference"
LATE = (0.030, 0.033)
REFINED = {"order": 6, "grading": 1.8, "tip_size": 5e-6}
# order, grading and tip_size of the meshes of the convergence table; the last is the one the others are
# measured against
MESHES = ((5, 2.5, 5e-5), (6, 2.5, 5e-5), (6, 1.8, 5e-5), (6, 1.8, 1.6e-5), (6, 1.8, 5e-6), (7, 1.6, 1.6e-6))


def read_reference():
    """Histories and frequencies 1-10 of an independent hp finite element computation (error 2e-4)."""
    modes = json.loads((FOLDER / "reference.json").read_text())["modes"]
    frequencies = np.array(modes["crack80_nu33"]["frequency_Hz"][:10])
    return dict(np.load(FOLDER / "transient_paper.npz")), frequencies


def build(comm, **choice):
    """Case P on a mesh."""
    beam = Beam(length=0.400, height=0.005, notches=[VNotch(x=0.080, depth=0.0025, opening=0.0458366)])
    mesh = sb.on_root(comm, lambda: beam.mesh(**choice))
    return sb.Model(mesh, sb.Material(young=70e9, poisson=0.33, density=2700), clamped="left")


def burst(force):
    """Eq. (39) at A."""
    return sb.PointForce("A", fy=sb.ToneBurst(force, frequency=3000.0, cycles=100))


def print_tables(out, rows, histories, reference, duration):
    """Errors, energy and peak resultant."""
    out.print(table(rows, reference))
    for force in (1.0, 300.0):
        energy = histories["refined", force].energy
        out.print(
            f"{force:g} N: peak external work {np.abs(energy.external).max():.6g} J, kept at the end "
            f"{energy.total[-1]:.6g} J, "
            "largest error of the energy balance "
            f"{np.abs(energy.balance).max() / np.abs(energy.external).max():.1e} of the peak work"
        )
    peak, exact = (
        resultant[times <= duration * (1 + 1e-9)].max()
        for resultant, times in (
            (histories["refined", 300.0].contact_resultant, histories["refined", 300.0].time),
            (reference["contact_resultant_300N"], reference["t"]),
        )
    )
    out.print(
        f"300 N: peak contact resultant {peak:.1f} N, reference {exact:.1f} N ({relative(peak, exact)})"
    )


def distance(history, reference, force):
    """Relative L2 distance of u_y(A) to the reference, over the time both have."""
    times, exact = (
        (reference["t_linear"], reference["uA_y_1N_linear"])
        if force == 1.0
        else (reference["t"], reference["uA_y_300N_contact"])
    )
    both = times <= history.time[-1] * (1 + 1e-9)
    found = np.interp(times[both], history.time, history.displacement("A")[:, 1])
    return float(np.linalg.norm(found - exact[both]) / np.linalg.norm(exact[both]))


def relative(value, exact):
    """Relative difference as text."""
    return f"{value / exact - 1.0:+.1e}" if exact else "reference is zero"


def table(rows, reference):
    """Errors of both meshes beside what is asked for."""
    result = Table(
        title="u_y(A) against the reference",
        caption="frequencies: largest relative error of 1-10; a history's first line includes the reduction "
        'to modes ("+")',
    )
    for name in (
        "mesh",
        "pairs",
        "frequencies",
        "force",
        "relative L2",
        "asked",
        "peak |u_y(A)|, m",
        "peak resultant, N",
        "exchanges",
        "seconds",
    ):
        result.add_column(name, justify="right")
    for mesh, pairs, error, force, history, seconds in rows:
        asked = {1.0: "1e-3", 300.0: "3e-3"}[force] if mesh == "refined" else ""
        result.add_row(
            mesh,
            str(pairs),
            f"{error:.1e}",
            f"{force:g} N",
            f"{distance(history, reference, force):.2e}",
            asked,
            f"{abs(history.displacement('A')[:, 1]).max():.5e}",
            f"{history.contact_resultant.max():.1f}",
            f"{history.exchanges:,d}",
            f"{seconds:.2f}{' +' if force == 1.0 else ''}",
        )
    return result


def convergence(comm, duration, reference):
    """Tables of errors at 300 N over modes, steps and meshes."""

    def study(title, parameter, cases, rate_of, note):
        result = Table(title=title, caption=note)
        for name in (parameter, "to the reference", "to the finest", "observed rate", "peak resultant, N"):
            result.add_column(name, justify="right")
        finest = cases[-1][2].displacement("A")[:, 1]
        last = None
        for name, size, history in cases:
            found = history.displacement("A")[:, 1]
            stride = (len(finest) - 1) / (len(found) - 1)
            exact = np.interp(np.arange(len(found)) * stride, np.arange(len(finest)), finest)
            error = float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
            rate = (
                f"{np.log(last[1] / error) / np.log(rate_of(last[0], size)):.2f}"
                if last and error > 0.0 and rate_of(last[0], size) > 1.0
                else ""
            )
            result.add_row(
                name,
                f"{distance(history, reference, 300.0):.2e}",
                f"{error:.2e}" if error else "",
                rate,
                f"{history.contact_resultant.max():.1f}",
            )
            last = size, error
        return result

    model = build(comm, **REFINED)
    counts = [sb.transient(model, burst(300.0), duration, step=1e-6, modes=m) for m in (40, 80, 150, 250)]
    yield study(
        "Modes (refined mesh, step 1 us)",
        "modes",
        [(f"{len(h.reduced.omega)}", len(h.reduced.omega), h) for h in counts],
        lambda a, b: b / a,
        "rate: power of 1 / modes",
    )
    steps = [
        sb.transient(counts[1].reduced, burst(300.0), duration, step=s)
        for s in (4e-6, 2e-6, 1e-6, 0.5e-6, 0.25e-6)
    ]
    yield study(
        "Steps (refined mesh, 80 modes)",
        "step, us",
        [(f"{h.step * 1e6:.3g}", h.step, h) for h in steps],
        lambda a, b: a / b,
        "rate: power of the step; the finest one's own error is not taken off",
    )
    model.destroy()
    meshes = []
    for order, grading, tip_size in MESHES:
        model = build(comm, order=order, grading=grading, tip_size=tip_size)
        history = sb.transient(model, burst(300.0), duration, step=1e-6, modes=80)
        meshes.append(
            (
                f"order {order}, grading {grading:g}, "
                f"tip {tip_size * 1e6:3g} um, {len(model.pairs):3d} pairs",
                tip_size,
                history,
            )
        )
        model.destroy()
    yield study(
        "Meshes (80 modes, step 1 us)",
        "mesh",
        meshes,
        lambda a, b: a / b,
        "rate: power of the tip size, where it changes; the finest one's own error is not taken off",
    )


def write_histories(folder, histories):
    """One CSV of each force on the refined mesh: time, u_y(A), contact resultant, mouth gap."""
    for (mesh, force), history in histories.items():
        if mesh == "refined":
            columns = {
                "time_s": history.time,
                "uA_y_m": history.displacement("A")[:, 1],
                "contact_resultant_N": history.contact_resultant,
                "mouth_gap_m": history.gap[:, -1],
            }
            write_table(os.path.join(folder, f"history_{force:g}N.csv"), columns)


def pictures(folder, comm, histories, reference, duration):
    """Figs. 5 and 6: the whole history and its last 3 ms, beside the reference."""
    late = LATE if duration > LATE[0] else (0.9 * duration, duration)
    for number, force, scale, unit, times, key in (
        (5, 1.0, 1e6, "µm", "t_linear", "uA_y_1N_linear"),
        (6, 300.0, 1e3, "mm", "t", "uA_y_300N_contact"),
    ):
        history = histories["refined", force]
        both = {
            "reference": (reference[times], reference[key]),
            "sbfem-petsc": (history.time, history.displacement("A")[:, 1]),
        }
        panels = [
            Panel(
                f"$u_y$(A) ({unit})",
                both,
                scale,
                (0.0, duration),
                title=f"{force:g} N, relative L2 distance {distance(history, reference, force):.1e}",
            ),
            Panel(f"$u_y$(A) ({unit})", both, scale, late, title="the last milliseconds"),
        ]
        if force > 1.0:
            resultant = {
                "reference": (reference["t"], reference["contact_resultant_300N"]),
                "sbfem-petsc": (history.time, history.contact_resultant),
            }
            mouth = {
                "reference": (reference["t"], reference["mouth_gap_300N"]),
                "sbfem-petsc": (history.time, history.gap[:, -1]),
            }
            panels += [
                Panel("resultant (kN)", resultant, 1e-3, (0.0, duration), title="contact resultant"),
                Panel(
                    "resultant (kN)", resultant, 1e-3, late, title="contact resultant, the last milliseconds"
                ),
                Panel("gap (µm)", mouth, 1e6, late, title="gap at the mouth, the last milliseconds"),
            ]
        drawing = plot_histories(panels, comm=comm)
        save_pictures(folder, **{f"figure_{number}_{force:g}N": drawing})
