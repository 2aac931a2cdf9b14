"""The example of the paper's beam: files, and its numbers beside the independent reference."""

import numpy as np
import pytest

from sbfem_petsc.study.reading import read
from tests.examples.programs import check_help, run
from tests.reference import frequencies, statics

CASE = "x80_mouth2um_nu33"


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """What the example prints, and its folder."""
    folder = tmp_path_factory.mktemp("beam")
    return run("beam_notch.py", "--output", folder / "files", folder=folder), folder / "files"


@pytest.fixture(scope="module")
def results(ran):
    return read(ran[1] / "beam_notch.h5")


@pytest.mark.slow
def test_files_and_pictures(ran):
    done, folder = ran
    assert {path.name for path in folder.iterdir()} == {
        "beam_notch.h5",
        "static_300N.vtu",
        "discretisation.png",
        "modes.png",
        "crack.png",
        "contact.png",
    }
    assert all(path.stat().st_size > 10_000 for path in folder.iterdir())
    assert done.stderr == "" and "…" not in done.stdout


@pytest.mark.slow
def test_frequencies(results):
    """Measured: 1.1e-5, mode 46."""
    found = results["modes"].frequencies
    assert len(found) == 46
    np.testing.assert_allclose(found, frequencies("crack80_nu33")[:46], rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("force, tolerance", [("1 N", 1e-4), ("100 N", 2e-4), ("300 N", 2e-4)])
def test_statics(results, force, tolerance):
    """The tolerances of tests/analysis/test_static.py, the project's statement of accuracy; measured: 1.5e-5,
    6.3e-5, 5.2e-6.
    """
    points, exact = results[force].point_displacements, statics(CASE, force)["u"]
    for point, axis, name in (("A", 1, "uy"), ("B", 0, "ux"), ("C", 0, "ux")):
        assert points[point][axis] == pytest.approx(exact[point][name], rel=tolerance), point


@pytest.mark.slow
def test_resultant(results):
    """300 N closes the whole notch: within 5 % on the default tip element; measured: 1.8 %."""
    assert results["300 N"].active.all()
    assert results["300 N"].contact_resultant == pytest.approx(
        statics(CASE, "300 N")["cracks"][0]["resultant"], rel=0.05
    )


@pytest.mark.slow
def test_printed_tables(ran):
    """Frequencies and displacements with their errors beside the reference."""
    rows = [line.split("│")[1:-1] for line in ran[0].stdout.splitlines() if line.startswith("│")]
    assert len(rows) == 46 + 3 and rows[-1][0].strip() == "300 N"
    assert all(abs(float(row[3])) < 2e-5 for row in rows)
    for text in (
        "Natural frequencies, crack open",
        "Static contact, force at A in +y",
        "58 of 71 pairs in contact",
    ):
        assert text in " ".join(ran[0].stdout.split())


@pytest.mark.long
def test_two_ranks_and_petsc_options(tmp_path):
    """Conjugate gradients for the statics on two ranks, on a coarse mesh: the numbers of one rank, and no
    option left unused.
    """
    coarse = ["--no-pictures", "--order", 3, "--tip-size", 2e-4, "--output"]
    options = ["-static_ksp_type", "cg", "-static_ksp_rtol", "1e-10"]
    run("beam_notch.py", *coarse, tmp_path / "one")
    done = run("beam_notch.py", *coarse, tmp_path / "two", *options, ranks=2)
    assert done.stdout.count("Static contact, force at A") == 1 and "\x1b" not in done.stdout
    assert "cg" in done.stdout and "unused" not in done.stdout.replace("There are no unused options", "")
    one, two = (read(tmp_path / folder / "beam_notch.h5") for folder in ("one", "two"))
    np.testing.assert_allclose(two["modes"].frequencies, one["modes"].frequencies, rtol=1e-7)
    np.testing.assert_allclose(two["100 N"].displacement("A"), one["100 N"].displacement("A"), rtol=1e-6)


def test_help():
    check_help(
        "beam_notch.py",
        2,
        ("--order", "--tip-size", "--output", "--no-pictures"),
    )
