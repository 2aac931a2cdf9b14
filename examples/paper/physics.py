"""The breathing beam held against a textbook's bilinear oscillator."""

from __future__ import annotations

import numpy as np

import sbfem_petsc as sb
from sbfem_petsc import indicators
from sbfem_petsc.plot.drawing import BLUE, VERMILION, figure, save_picture, style

from .bench import Bench, closed_frequencies, push
from .findings import Claim, Finding, Part, Table, percent

PERIODS, STEPS, SHOWN = 200, 2000, 2.5
LARGE = 20e3  # N


def bilinear(bench: Bench) -> Finding:
    """Free vibration of the beam of Long et al. in mode 1, closed crack, undamped, against 2 f_o f_c /
    (f_o + f_c).
    """
    model = bench.model("Long, cracked", order=4)
    reduced = bench.reduced("Long, cracked", modes=20, order=4)
    opened, closed = float(reduced.frequencies[0]), float(closed_frequencies(reduced)[0])
    healthy = float(sb.modal(bench.model("Long, healthy", order=4), 1).frequencies[0])
    expected = formula(opened, closed)
    velocity = np.zeros(len(reduced.omega))
    velocity[0] = 1e-3
    history = sb.transient(
        model,
        push(0.0),
        PERIODS / expected,
        step=1.0 / (STEPS * expected),
        modes=len(velocity),
        initial=(np.zeros_like(velocity), velocity),
        progress=None,
    )
    u = history.displacement("A")[:, 1]
    rising = np.flatnonzero((u[:-1] < 0.0) & (u[1:] >= 0.0))
    crossings = history.time[rising] - u[rising] * history.step / (u[rising + 1] - u[rising])
    found = float((len(crossings) - 1) / (crossings[-1] - crossings[0]))
    touching = history.contact_resultant > 0.0
    drift = float(np.abs(history.energy.balance).max() / history.energy.total[0])
    ratios = indicators.harmonic_ratios(indicators.harmonics(history.time, u, found, 4))
    textbook = textbook_ratios(opened / closed)
    rows = [
        ["open crack", opened],
        ["closed crack, faces tied along their normal", closed],
        ["healthy", healthy],
        ["bilinear formula 2 f_o f_c / (f_o + f_c)", expected],
        [f"free vibration, {len(crossings) - 1} periods", found],
    ]
    high = resonance(bench)
    numbers = {
        "mode_17": high,
        "open": opened,
        "closed": closed,
        "healthy": healthy,
        "bilinear": expected,
        "found": found,
        "difference": found / expected - 1.0,
        "energy_drift": drift,
        "share_of_time_in_contact": touching.mean(),
        "harmonic_ratios": ratios,
        "textbook_ratios": textbook,
    }
    claims = [
        Claim(
            "the frequency of the breathing beam is 2 f_o f_c / (f_o + f_c) within 1e-4",
            f"{found:.4f} Hz against {expected:.4f} Hz ({percent(found / expected - 1.0)}), between "
            f"{opened:.4f} (open) and {closed:.4f} Hz (closed)",
            abs(found / expected - 1.0) < 1e-4,
            "check",
        ),
        Claim(
            "so is the resonance of mode 17 under a force beside which the mouth's 2 µm are small, within "
            f"1e-3 ({LARGE / 1e3:g} kN, ζ = 0.002)",
            f"peak at {high['peak']:.1f} Hz against {high['bilinear']:.1f} Hz "
            f"({percent(high['peak'] / high['bilinear'] - 1.0)}), between {high['open']:.1f}"
            f" and {high['closed']:.1f} Hz",
            abs(high["peak"] / high["bilinear"] - 1.0) < 1e-3,
            "check",
        ),
        Claim(
            "energy is conserved within 1e-5 over 200 periods",
            f"largest change {drift:.1e}",
            drift < 1e-5,
            "check",
        ),
    ]
    tables = [
        Table("First frequency of the beam of Long et al., Hz", ["state", "Hz"], rows, ["text", "frequency"]),
        Table(
            "Harmonics of the free vibration of A relative to the first",
            ["", "mean", "2", "3", "4"],
            [["beam", *np.delete(ratios, 1)], ["bilinear oscillator", *np.delete(textbook, 1)]],
            ["text"] + ["error"] * 4,
        ),
    ]
    notes = [
        "A closed crack without friction is hardly softer than none: its faces may slide.",
        "The harmonics at A are not those of the bilinear oscillator with the same two frequencies: the kink "
        "at the crack is not of the first mode's shape.",
    ]
    shown = history.time < SHOWN / expected
    return Finding(
        numbers,
        tables,
        claims,
        notes,
        {"time": history.time[shown], "u": u[shown], "resultant": history.contact_resultant[shown]},
    )


def formula(opened: float, closed: float) -> float:
    """Frequency of a bilinear oscillator: half a period open, half a period closed."""
    return 2.0 * opened * closed / (opened + closed)


def resonance(bench: Bench) -> dict[str, float]:
    """Peak of the paper's beam near mode 17 under a large force, and the bilinear formula, Hz."""
    reduced = bench.reduced("tables", 0.002)
    opened, closed = float(reduced.frequencies[16]), float(closed_frequencies(reduced)[16])
    curve = sb.frequency_response(
        reduced,
        push(LARGE),
        14100.0,
        14400.0,
        steps=256,
        stability=False,
        progress=None,
    )
    return {
        "open": opened,
        "closed": closed,
        "bilinear": formula(opened, closed),
        "peak": curve.peak("A").frequency,
    }


def textbook_ratios(ratio: float, count: int = 4) -> np.ndarray:
    """|c_k| / |c_1| of the free vibration of a bilinear oscillator that is soft on one side, ratio =
    w_open / w_closed < 1.
    """
    t = np.linspace(0.0, 1.0, 200001)[:-1]
    half = ratio / (1.0 + ratio)  # the stiff side's share of the period; unit velocity at both crossings
    u = np.where(
        t < half, np.sin(np.pi * t / half) * half, -np.sin(np.pi * (t - half) / (1.0 - half)) * (1.0 - half)
    )
    c = np.abs(np.fft.rfft(u))[: count + 1] / len(t)
    c[1:] *= 2.0
    return c / c[1]


def draw(finding: Finding, path: str) -> None:
    """Displacement and contact resultant of the free vibration."""
    drawing = figure(2.5, 4.8)
    axes = drawing.subplots()
    c, other = finding.curves, axes.twinx()
    axes.plot(c["time"] * 1e3, c["u"] * 1e6, color=BLUE, linewidth=1.0)
    other.plot(c["time"] * 1e3, c["resultant"], color=VERMILION, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.axhline(0.0, color="#999999", linewidth=0.4, zorder=0.5)
    axes.set_xlabel("time (ms)")
    axes.set_ylabel("$u_y$(A) (µm)", color=BLUE)
    other.set_ylabel("contact resultant (N)", color=VERMILION)
    axes.set_xlim(0.0, c["time"][-1] * 1e3)
    for a in (axes, other):
        style(a)
        a.yaxis.label.set_size(8)
    save_picture(drawing, path)


PARTS = [
    Part(
        "bilinear",
        "Check: frequency of the breathing beam against the bilinear formula",
        bilinear,
        draw,
        "Free vibration of the beam of Long et al. in its first mode, closed crack, undamped: displacement "
        "of A and contact resultant (broken).",
        2.0,
    )
]
