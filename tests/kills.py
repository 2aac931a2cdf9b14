"""Runs of each kind that keeps a file, killed at any byte written, at the flush of a state or its renaming:
nothing is lost beyond the last frame, and a run that goes on ends where an undisturbed one does, bit by bit.

    python -m tests.kills            # names of the kinds
    python -m tests.kills tori 100   # so many kills of one, or of all: one line each
"""

from __future__ import annotations

import functools
import os
import random
import signal
import sys
import tempfile
import warnings
from collections.abc import Callable

import numpy as np

import sbfem_petsc as sb
from meshing import Beam
from sbfem_petsc.motion import reduced_history
from sbfem_petsc.motion.files import run_file
from sbfem_petsc.motion.unreduced import history as unreduced_history
from sbfem_petsc.record import journal
from sbfem_petsc.study import rows
from tests.continuation.families import FAMILIES
from tests.study.small_case import CASE

SWEEP = """
[sweep]
analyses = ["frequencies", "push"]

[sweep.parameters]
"loads.push.fy" = [100.0, 200.0, 300.0]
"""


@functools.cache
def body() -> sb.Model:
    """A cracked beam of few unknowns."""
    from meshing import VNotch

    beam = Beam(0.05, 0.005, notches=[VNotch(x=0.02, depth=0.0025, opening=0.0458366)])
    return sb.Model(beam.mesh(order=2), sb.Material(70e9, 0.33, 2700), damping=0.01)


def history(reduction: str | None, **file) -> list[np.ndarray]:
    """Of five chunks."""
    load = sb.PointForce("A", fy=sb.ToneBurst(3000.0, 3000, 3))
    found = sb.transient(body(), load, 1.6e-4, 2e-6, modes=6, reduction=reduction, **file)
    return [found.displacement("A"), found.velocity("A"), found.contact_force, found.gap]


def case(more: str = "") -> str:
    """Text of a case without what takes long."""
    begin, end = CASE.index("[analyses.steady]"), CASE.index("[output]")
    return CASE[:begin] + CASE[end:] + more


def rows_of(file: str | None = None, resume: bool = True) -> list[np.ndarray]:
    """The three rows of a sweep."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "case.toml")
        with open(path, "w") as text:
            text.write(case(SWEEP))
        found = sb.sweep(path, output=file or os.path.join(folder, "out"))
    assert not any(found.reasons), found.reasons
    return [found.values[name] for name in sorted(found.values)]


# A branch of tori that ends behind the change of its samples: two seconds a kill.
SHORT = {"tori": functools.partial(FAMILIES["tori"], 0.6029)}
KINDS: dict[str, Callable[..., list[np.ndarray]]] = {
    "reduced": functools.partial(history, "modes"),
    "direct": functools.partial(history, None),
    **{name: lambda _run=run, **file: [_run(**file)[0]] for name, run in (FAMILIES | SHORT).items()},
    "sweep": rows_of,
}


class Writes:
    """What a process writes, counted and told to a pipe: after so many events it dies, within one where that
    writes bytes.
    """

    def __init__(self, last: int | None = None, share: float = 0.0, tell: int | None = None):
        self.count, self.last, self.share, self.tell = 0, last, share, tell
        self._write, self._sync, self._replace = os.write, os.fsync, os.replace
        os.write, os.fsync, os.replace = self.write, self.fsync, self.replace

    def _now(self) -> bool:
        self.count += 1
        return self.count == self.last

    def write(self, file: int, data) -> int:
        if not self._now():
            return self._write(file, data)
        self._write(file, bytes(data)[: int(self.share * len(data))])
        os.kill(os.getpid(), signal.SIGKILL)
        return 0

    def fsync(self, file: int) -> None:
        if self._now():
            os.kill(os.getpid(), signal.SIGKILL)

    def replace(self, one, other) -> None:
        if self._now():
            os.kill(os.getpid(), signal.SIGKILL)
        self._replace(one, other)

    def after(self, function: Callable) -> Callable:
        """Tell of each whole frame or row, once it is written."""

        @functools.wraps(function)
        def told(*arguments, **options):
            result = function(*arguments, **options)
            if self.tell is not None:
                self._write(self.tell, b".")
            return result

        return told


def forked(work: Callable[[], int]) -> int:
    """Of a process of its own, how it ended."""
    child = os.fork()
    if not child:
        code = 99
        try:
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def quick() -> None:
    """Small chunks, and a state behind every frame."""
    warnings.simplefilter("ignore")
    reduced_history.CHUNK = unreduced_history.CHUNK = 16
    run_file.PAUSE = 0.0


def kept(kind: str, path: str) -> int:
    """Whole frames or rows that stand in a file."""
    if kind == "sweep":
        found = os.path.join(path, "rows")
        return len(rows.read(found)) if os.path.isdir(found) else 0
    return max(0, sum(1 for _ in journal.frames(path)) - 1) if os.path.exists(path) else 0


def trials(kind: str, count: int, seed: int = 0) -> tuple[int, int]:
    """Kill so many runs; how many died within a run, and with how many frames in all."""
    quick()
    run, random_ = KINDS[kind], random.Random(f"{kind} {seed}")
    expected = run()

    def counted() -> int:
        with tempfile.TemporaryDirectory() as folder:
            counts = Writes()
            run(file=os.path.join(folder, "run"))
            with open(answer, "w") as file:
                file.write(str(counts.count))
        return 0

    with tempfile.TemporaryDirectory() as folder:
        answer = os.path.join(folder, "count")
        assert forked(counted) == 0
        with open(answer) as file:
            events = int(file.read())
    died = frames = 0
    for _ in range(count):
        with tempfile.TemporaryDirectory() as folder:
            path, (told, tell) = os.path.join(folder, "run"), os.pipe()
            last, share = random_.randint(1, events), random_.random()

            def killed(last=last, share=share, tell=tell, path=path) -> int:
                writes = Writes(last, share, tell)
                journal.Journal.append = writes.after(journal.Journal.append)
                rows.append = writes.after(rows.append)
                run(file=path, resume=True)
                return 0

            code = forked(killed)
            os.close(tell)
            with os.fdopen(told, "rb") as pipe:
                whole = len(pipe.read())
            where = f"{kind}: killed at event {last} of {events}, {share:.3f} of it"
            assert code in (0, -signal.SIGKILL), f"{where}: ended with {code}"
            assert kept(kind, path) in (whole, whole + 1), f"{where}: {kept(kind, path)} of {whole} frames"

            if kind in ("reduced", "direct") and whole:
                assert journal.read(path).vouched >= whole - 1, f"{where}: the state is of earlier frames"

            def resumed(path=path) -> int:
                found = run(file=path, resume=True)
                return int(not all(map(functools.partial(np.array_equal, equal_nan=True), found, expected)))

            code_again = forked(resumed)
            assert code_again == 0, f"{where}: gone on with, it ended with {code_again}"
            died, frames = died + (code != 0), frames + whole
    return died, frames


if __name__ == "__main__":
    if len(sys.argv) < 2:
        print(*KINDS)
    else:
        for kind in KINDS if sys.argv[1] == "all" else sys.argv[1].split(","):
            died, frames = trials(kind, int(sys.argv[2]))
            print(f"{kind}: {died} of {sys.argv[2]} killed, {frames} frames, none lost, all resumed bitwise")
