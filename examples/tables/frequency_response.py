"""What frequency_response.py looks for along its curves, prints, writes and draws."""

import dataclasses
import os

import numpy as np
from rich.table import Table

import sbfem_petsc as sb
from sbfem_petsc.plot import plot_branches, plot_multipliers, save_pictures
from sbfem_petsc.plot.branches import in_order, split
from sbfem_petsc.writing import write_table

# Distances off an unstable motion, relative to its state, at which one of twice the period is looked for;
# least amplitude at half the drive over the first harmonic.
ASIDE, SEEN = (0.02, 0.1), 1e-6
TRIES = 6


def doublings(load, curve):
    """Motions of twice the period: at period doublings, and near unstable motions with a negative real
    multiplier.
    """
    result = []
    if not curve.contact:
        return result
    for item in curve.bifurcations:
        if item.kind == "period doubling":
            try:
                result.append(sb.switch_branch(curve, item))
            except sb.SolveError:
                continue
    real = (curve.multipliers.imag == 0.0) & (curve.multipliers.real < -1.0)
    for k in np.flatnonzero(real.any(axis=1))[:TRIES]:
        orbit = curve.orbit(int(k))
        direction = np.random.default_rng(0).standard_normal(len(orbit.state))
        for share in ASIDE:
            # the disturbance that grows shows itself whatever the direction
            start = dataclasses.replace(
                orbit,
                state=orbit.state
                + share * np.linalg.norm(orbit.state) * direction / np.linalg.norm(direction),
            )
            try:
                other = sb.periodic(
                    curve.reduced, load, orbit.frequency, periods=2, steps=len(orbit.time), guess=start
                )
            except sb.SolveError:
                continue
            if half(other) > SEEN:
                result.append(other)
                break
    return result


def half(orbit):
    """Amplitude at half the drive over the first harmonic."""
    return float(abs(orbit.subharmonics("A")[1]) / abs(orbit.harmonics("A")[1]))


def unstable(curve):
    """Frequencies between which a curve is unstable, in order of its arc length, Hz."""
    marks = [(item.after, item.own_value, 0.0) for item in in_order(curve)]
    return [
        (float(value.min()), float(value.max()))
        for stable, value, _ in split(curve.value, 0.0 * curve.value, curve.stable, marks)
        if not stable
    ]


def together(curve):
    """Frequencies with two stable motions of the curve, Hz, or None."""
    marks = [(item.after, item.own_value, 0.0) for item in in_order(curve)]
    pieces = []
    for stable, value, _ in split(curve.value, 0.0 * curve.value, curve.stable, marks):
        turns = np.flatnonzero(np.diff(np.sign(np.diff(value))) != 0) + 1
        pieces += [(part.min(), part.max()) for part in np.split(value, turns) if stable and len(part) > 1]
    shared = [(max(a[0], b[0]), min(a[1], b[1])) for n, a in enumerate(pieces) for b in pieces[:n]]
    shared = [(low, high) for low, high in shared if high - low > 1e-6 * high]
    return (float(min(s[0] for s in shared)), float(max(s[1] for s in shared))) if shared else None


def lines(curve):
    """Frequencies over the drive that multipliers leaving the circle announce where stability is lost or won,
    ascending.
    """
    ends = [
        item
        for item in curve.bifurcations
        if item.kind == "Neimark-Sacker" and curve.stable[item.after] != curve.stable[item.after - 1]
    ]
    return sorted({round(abs(float(np.angle(item.multiplier))) / (2.0 * np.pi), 3) for item in ends})


def peaks(found):
    """Peak, shift, skewness and bandwidth."""
    result = Table(
        title="Peaks of half the peak-to-peak u_y(A)",
        caption="shift: of the peak from that without contact; skewness: above 0 where the peak leans to "
        "higher frequencies, above 1 where it overhangs; bandwidth: between the half-power "
        "frequencies",
    )
    for name in (
        "damping",
        "curve",
        "points",
        "peak, Hz",
        "amplitude / force, nm/N",
        "shift, Hz",
        "skewness",
        "bandwidth, Hz",
        "peak resultant, kN",
    ):
        result.add_column(name, justify="right")
    for damping, name, curve, _ in rows(found):
        peak = curve.peak("A")
        linear = found.get((damping, "no contact"))
        result.add_row(
            f"{damping:g}",
            name,
            str(len(curve.value)),
            f"{peak.frequency:.2f}",
            f"{1e9 * peak.amplitude / force_of(name):.4f}",
            f"{peak.frequency - linear[0].peak('A').frequency:+.2f}" if linear else "",
            f"{peak.skewness:+.3f}",
            f"{peak.bandwidth:.2f}",
            f"{curve.contact_peak.max() * 1e-3:.2f}",
        )
    return result


def stability(found):
    """Unstable ranges, bifurcations, subharmonics."""
    result = Table(
        title="Stability and subharmonics",
        caption="|mu|: the largest along the curve; lines: announced by the multipliers at the ends of "
        "unstable ranges, over the drive; f/2: largest amplitude on a motion of twice the period "
        "over A1",
    )
    for name in (
        "damping",
        "curve",
        "unstable, Hz",
        "bifurcations",
        "|mu| - 1",
        "two stable, Hz",
        "lines / f",
        "f/2",
    ):
        result.add_column(name, justify="right", no_wrap=True)
    for damping, name, curve, halves in rows(found):
        if curve.contact:
            kinds = [item.kind for item in curve.bifurcations]
            shared = together(curve)
            result.add_row(
                f"{damping:g}",
                name,
                "\n".join(f"{low:.1f}-{high:.1f}" for low, high in unstable(curve)) or "none",
                "\n".join(f"{kinds.count(kind)} {kind}" for kind in sorted(set(kinds))) or "none",
                f"{abs(curve.multipliers[:, 0]).max() - 1.0:+.1e}",
                f"{shared[0]:.1f}-{shared[1]:.1f}" if shared else "none",
                "\n".join(f"{line:.3f}" for line in lines(curve)) or "none",
                strongest(halves),
            )
    return result


def strongest(halves):
    """The motion of twice the period with the largest amplitude at half the drive, as text."""
    if not halves:
        return "none"
    orbit = max(halves, key=half)
    return f"{half(orbit):.1e} at\n{orbit.frequency:.1f} Hz,\n{'stable' if orbit.stable else 'unstable'}"


def rows(found):
    return [(damping, name, curve, halves) for (damping, name), (curve, halves) in found.items()]


def force_of(name):
    return 1.0 if name == "no contact" else float(name.split()[0])


def keep(folder, name, damping, curve, halves):
    """HDF5 of a curve and of the motions of twice the period found from it."""
    plain = f"{name.replace(' ', '')}_damping_{damping:g}"
    sb.save(os.path.join(folder, f"curve_{plain}.h5"), curve)
    for number, orbit in enumerate(halves):
        sb.save(os.path.join(folder, f"doubled_{plain}_{number}.h5"), orbit)


def write(folder, found):
    """CSV of what the tables say, one row a curve, and of each curve."""
    lines_ = []
    for damping, name, curve, halves in rows(found):
        peak, kinds = curve.peak("A"), [item.kind for item in curve.bifurcations]
        some = curve.multipliers.size > 0
        largest = abs(curve.multipliers[:, 0]) if some else np.full(len(curve.value), np.nan)
        lines_.append(
            {
                "damping": f"{damping:g}",
                "force_N": f"{force_of(name):g}",
                "contact": str(curve.contact),
                "points": str(len(curve.value)),
                "complete": str(curve.complete),
                "peak_Hz": f"{peak.frequency:.6f}",
                "peak_m": f"{peak.amplitude:.9e}",
                "skewness": f"{peak.skewness:.6f}",
                "bandwidth_Hz": f"{peak.bandwidth:.6f}",
                "unstable_Hz": " ".join(f"{low:.3f}-{high:.3f}" for low, high in unstable(curve)),
                "folds": str(kinds.count("fold")),
                "period_doublings": str(kinds.count("period doubling")),
                "neimark_sacker": str(kinds.count("Neimark-Sacker")),
                "grazing": str(kinds.count("grazing")),
                "largest_multiplier": f"{largest.max():.9f}" if some else "",
                "half_over_first": f"{max(map(half, halves)):.6e}" if halves else "",
            }
        )
        columns = {"frequency_Hz": curve.value, "amplitude_m": curve.amplitude("A")}
        columns |= {"stable": curve.stable.astype(float), "largest_multiplier": largest}
        columns |= {f"A{k}_m": abs(curve.harmonics("A")[:, k]) for k in range(7)}
        file = f"curve_{name.replace(' ', '')}_damping_{damping:g}.csv"
        write_table(os.path.join(folder, file), columns)
    if lines_:
        table = {key: [line[key] for line in lines_] for key in lines_[0]}
        write_table(os.path.join(folder, "curves.csv"), table)


def pictures(folder, comm, found, damping):
    """The figure, and the multipliers along the curve of the largest force."""
    curves = {name: curve for ratio, name, curve, _ in rows(found) if ratio == damping}
    if not curves:
        return
    drawing = plot_branches(
        curves,
        "A",
        forces={name: force_of(name) for name in curves},
        title=f"modal damping ratio {damping:g}",
        comm=comm,
    )
    save_pictures(folder, **{f"figure_11_damping_{damping:g}": drawing})
    last = list(curves)[-1]
    if curves[last].multipliers.size:
        title = f"{last}, modal damping ratio {damping:g}"
        drawing = plot_multipliers(curves[last], title=title, comm=comm)
        save_pictures(folder, **{f"multipliers_{last.replace(' ', '')}_damping_{damping:g}": drawing})
