"""A small case that runs in a second, and the command in this process."""

import contextlib
import io
import json
import os
import pathlib
import subprocess
import sys
import time
from dataclasses import dataclass

from sbfem_petsc.study import rows
from tests.parallel import ROOT, interruptible

CASE = """\
title = "small"

[geometry]
kind = "beam"
length = 0.1
height = 0.01

[[geometry.notches]]
x = 0.05
depth = 0.004
opening = 0.005

[mesh]
order = 3

[material]
young = 70e9
poisson = 0.33
density = 2700

[model]
clamped = "left"
damping = 0.01

[loads.push]
kind = "point_force"
point = "A"
fy = 200.0

[loads.burst]
kind = "point_force"
point = "A"
fy = { kind = "tone_burst", amplitude = 100.0, frequency = 2000.0, cycles = 4 }

[analyses.frequencies]
kind = "modal"
count = 5

[analyses.push]
kind = "static"
load = "push"

[analyses.steady]
kind = "periodic"
load = "push"
frequency = 400.0
modes = 12
steps = 256

[analyses.burst]
kind = "transient"
load = "burst"
duration = 0.003
modes = 12

[output]
pictures = false
"""

SWEEP = """
[sweep]
analyses = ["frequencies", "steady"]
noise = { snr = 60.0, seed = 3 }

[sweep.parameters]
"geometry.notches[0].depth" = [0.002, 0.004]
"loads.push.fy" = { start = 100.0, stop = 300.0, count = 3 }
"""


def written(folder: pathlib.Path, text: str = CASE, name: str = "case.toml") -> pathlib.Path:
    """A case file in a folder."""
    path = folder / name
    path.write_text(text)
    return path


@dataclass
class Done:
    """What a command has said, and its exit code."""

    code: int
    out: str
    err: str

    @property
    def answer(self):
        """Its answer in JSON."""
        return json.loads(self.out)


def sbfem(*arguments) -> Done:
    """The command in this process."""
    from sbfem_petsc.cli import main

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(a) for a in arguments])
        except SystemExit as ended:
            code = int(ended.code or 0)
    return Done(code, out.getvalue(), err.getvalue())


# Commands one after another on the same ranks, which end with the code that all have ended with.
COMMANDS = """
import json, sys
from sbfem_petsc.cli import main
codes = set()
for command in json.loads(sys.argv[1]):
    try:
        main(command)
    except SystemExit as ended:
        codes.add(ended.code)
sys.exit(codes.pop() if len(codes) == 1 else f"ended with {codes}")
"""

# A sweep that waits for a signal when it has written its second row.
WAITING = """
import sys
from sbfem_petsc.cli import main
from sbfem_petsc.study import rows
from tests.parallel import wait_for_a_signal
append, written = rows.append, 0

def waiting(path, row):
    global written
    append(path, row)
    written += 1
    if written == 2:
        wait_for_a_signal()

rows.append = waiting
main(sys.argv[1:])
"""


def stopped_sweep(number: int, path: pathlib.Path, out: pathlib.Path) -> tuple[int, str]:
    """Send a signal to a sweep that has written two rows; its exit code, and what it has said as an error."""
    process = started("sweep", path, "--output", out, "--quiet", program=("-c", WAITING))
    folder, limit = out / "rows", time.monotonic() + 120
    while not (folder.is_dir() and len(list(rows.every(str(folder)))) == 2):
        if process.poll() is not None or time.monotonic() > limit:
            process.kill()
            raise AssertionError(process.communicate()[1])
        time.sleep(0.01)
    process.send_signal(number)
    errors = process.communicate(timeout=300)[1]
    return process.returncode, errors


def started(*arguments, program: tuple[str, ...] = ("-m", "sbfem_petsc")) -> subprocess.Popen:
    """The command in a process of its own."""
    return subprocess.Popen(
        [sys.executable, *program, *map(str, arguments)],
        cwd=ROOT,
        # without a daemon of Open MPI's beside it, which outlives a process that is killed
        env={**os.environ, "OMPI_MCA_ess_singleton_isolated": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=interruptible,
    )
