"""Run an example as a user does, on one rank without mpiexec or on several."""

from __future__ import annotations

import os
import pathlib
import subprocess
import sys

from tests.parallel import ROOT, on_ranks

EXAMPLES = ROOT / "examples"


def run(
    example: str, *arguments, ranks: int = 1, folder: pathlib.Path | None = None, check: bool = True
) -> subprocess.CompletedProcess:
    """Run an example from a folder of its own (on one rank), so that nothing depends on the working
    directory.
    """
    arguments = [str(a) for a in arguments]
    script = str(EXAMPLES / example)
    if ranks > 1:
        return on_ranks(ranks, script, *arguments, check=check, timeout=300)
    environment = {"OMP_NUM_THREADS": "1", **os.environ}
    done = subprocess.run(
        [sys.executable, script, *arguments],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=300,
    )
    if check:
        assert done.returncode == 0, done.stdout + done.stderr
    return done


def printed(example: str, folder: pathlib.Path, *options: object, ranks: int = 1) -> str:
    """What an example prints, in one line."""
    done = on_ranks(ranks, f"examples/{example}.py", *map(str, options), "--output", str(folder))
    assert not done.stderr.strip(), done.stderr
    return " ".join(done.stdout.split())


def check_help(example: str, ranks: int, own: tuple[str, ...]) -> None:
    """`--help`, once over all ranks: the example's own options and how to see PETSc's."""
    done = run(example, "--help", ranks=ranks)
    for option in (*own, "--help"):
        assert option in done.stdout
    for hint in ("-static_ksp_", "-modal_eps_", "-help", "-log_view"):
        assert hint in done.stdout
    assert done.stdout.count("usage:") == 1 and done.stderr == ""
