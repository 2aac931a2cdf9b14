"""The transient examples run as programs and give their pinned numbers."""

import re

import pytest

from tests.parallel import on_ranks


def example(name, folder, *options, ranks=1):
    """What an example prints: its lines, and all in one line."""
    done = on_ranks(ranks, f"examples/{name}.py", *options, "--output", str(folder))
    assert not done.stderr.strip(), done.stderr
    return done.stdout.splitlines(), " ".join(done.stdout.split())


def cells(lines, *first):
    """Cells of the table row that starts with the given ones."""
    rows = [[cell.strip() for cell in line.split("│")[1:-1]] for line in lines if line.startswith("│")]
    found = [row for row in rows if tuple(row[: len(first)]) == first]
    assert found, (first, rows)
    return found[0]


@pytest.mark.long
def test_tone_burst(tmp_path):
    """Figs. 5 and 6 at steps of 2 us: 4.3e-4 at 1 N and 3.9e-4 at 300 N on the refined mesh, peak resultant
    0.014 % below the reference's 19146.2 N.
    """
    lines, text = example("tone_burst", tmp_path, "--step", "2e-6")
    one, many = (
        cells(lines, "refined", "115", "1.3e-06", "1 N"),
        cells(lines, "refined", "115", "1.3e-06", "300 N"),
    )
    assert float(one[4]) == pytest.approx(4.3e-4, rel=0.1) and float(many[4]) == pytest.approx(
        3.9e-4, rel=0.1
    )
    assert float(many[7]) == pytest.approx(19143.6, rel=1e-4)
    assert float(cells(lines, "default", "71", "5.9e-06", "300 N")[4]) == pytest.approx(4.8e-4, rel=0.1)
    assert all(float(error) < 1e-6 for error in re.findall(r"energy balance (\S+) of", text))
    for name in ("figure_5_1N.png", "figure_6_300N.png", "history_1N.csv", "history_300N.csv"):
        assert (tmp_path / name).stat().st_size > 20000


@pytest.mark.long
def test_short_tone_burst_on_two_ranks(tmp_path):
    """5 ms on a coarse mesh: the same numbers on one rank and two."""
    options = (
        "--duration",
        "0.005",
        "--order",
        "4",
        "--grading",
        "2.5",
        "--tip-size",
        "5e-5",
        "--step",
        "4e-6",
        "--modes",
        "40",
        "--no-pictures",
    )
    outputs = [example("tone_burst", tmp_path, *options, ranks=ranks)[0] for ranks in (1, 2)]
    for pairs in ("57", "71"):  # errors, and the greatest displacement to 1e-6
        one, two = (cells(lines, "refined" if pairs == "57" else "default", pairs) for lines in outputs)
        assert (
            one[:6] == two[:6]
            and float(one[6]) == pytest.approx(float(two[6]), rel=1e-4)
            and float(one[6]) > 0.0
        )


@pytest.mark.long
def test_long_beam(tmp_path):
    """Fig. 7: the line at f1 + f_omega stands at 1.14e-3 m/s^2 in the first second of the cracked beam (steps
    of 8 to 1 us: 1.63, 1.16, 1.12, 1.14e-3), and not in the healthy one.
    """
    _, text = example("long_beam", tmp_path, "--duration", "2", "--order", "4")
    open_crack, healthy, drive = (
        float(value)
        for value in re.search(
            r"open crack (\S+) Hz .*?healthy (\S+) Hz; driven at f_omega = (\S+) Hz", text
        ).groups()
    )
    assert (
        open_crack == pytest.approx(59.545, abs=2e-3)
        and healthy == pytest.approx(60.221, abs=2e-3)
        and drive == pytest.approx(2 * open_crack, abs=2e-4)
    )
    cracked, intact = (
        float(value)
        for value in re.search(r"early record: cracked (\S+), healthy (\S+) m/s\^2", text).groups()
    )
    assert cracked == pytest.approx(1.14e-3, rel=0.05) and intact < 1e-3 * cracked
    assert (tmp_path / "figure_7.png").stat().st_size > 20000


@pytest.mark.long
def test_modulation(tmp_path):
    """Fig. 10: modulation index 0.0114 (0.01155 settled, order 5) of the first pair and 0.13 of the second;
    none in the healthy beam.
    """
    _, text = example(
        "modulation", tmp_path, "--step", "5e-6", "--rise", "0.2", "--settle", "0.2", "--order", "3"
    )
    healthy, cracked = (
        [float(value) for value in values.split(", ")]
        for values in re.findall(r"of pairs 1-3 ((?:[\d.e+-]+(?:, )?){3})", text)
    )
    assert cracked[0] == pytest.approx(0.01144, rel=0.03) and cracked[1] == pytest.approx(0.129, rel=0.03)
    assert max(healthy) < 1e-3
    assert (tmp_path / "figure_10.png").stat().st_size > 20000


@pytest.mark.long
@pytest.mark.parametrize(
    "name, options, sentence",
    [
        ("modulation", ("--step", "3e-6"), "must divide the sampling interval"),
        ("long_beam", ("--duration", "0.1"), "too short to tell the lines apart"),
        ("tone_burst", ("--duration", "-1"), "duration = -1.0 must be finite and above 0 (s)"),
    ],
)
def test_bad_options(tmp_path, name, options, sentence):
    done = on_ranks(1, f"examples/{name}.py", *options, "--output", str(tmp_path), check=False)
    assert done.returncode != 0 and sentence in done.stderr and "Traceback" not in done.stderr
