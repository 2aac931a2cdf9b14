"""Two threads import two modules of ours at a time, as often as asked, with the race between them forced.

    python race.py ROUNDS SEED

prints each pair that failed, and how. Before each round our modules are forgotten, others stay. A thread that
looks for a module of ours, and holds its lock then, lets the other one go first: it waits until that has come
to a module itself, or a little while.
"""

from __future__ import annotations

import gc
import importlib
import pkgutil
import random
import sys
import threading
from collections.abc import Iterator
from typing import Any

PACKAGES = ("meshing", "sbfem_petsc")
PATIENCE = 0.001  # s, for a thread that may wait for a lock of ours


def ours(name: str) -> bool:
    return name.split(".")[0] in PACKAGES


def modules() -> Iterator[str]:
    """All of both packages but programs."""
    for package in PACKAGES:
        yield package
        path = importlib.import_module(package).__path__
        yield from (m.name for m in pkgutil.walk_packages(path, f"{package}.") if "__main__" not in m.name)


class Turns:
    """Finds no module, but lets the other thread go ahead whenever one of ours is looked for."""

    def __init__(self) -> None:
        self.moved = threading.Condition()
        self.count = self.at_work = 0

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> None:
        if ours(name):
            with self.moved:
                self.count += 1
                mine = self.count
                self.moved.notify_all()
                self.moved.wait_for(lambda: self.count > mine or self.at_work < 2, PATIENCE)

    def end(self) -> None:
        """One of the threads has ended: nobody waits for it."""
        with self.moved:
            self.at_work -= 1
            self.moved.notify_all()


def together(pair: tuple[str, str], turns: Turns) -> list[str]:
    """What goes wrong when two threads import one module each."""
    for name in [name for name in sys.modules if ours(name)]:
        del sys.modules[name]
    found: list[str] = []
    barrier = threading.Barrier(2)

    def work(name: str) -> None:
        barrier.wait()
        try:
            importlib.import_module(name)
        except BaseException as error:
            found.append(f"{name}: {type(error).__name__}: {error}")
        finally:
            turns.end()

    turns.at_work = len(pair)
    threads = [threading.Thread(target=work, args=(name,)) for name in pair]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def main(rounds: int, seed: int) -> None:
    names = sorted(modules())
    for name in names:  # what others bring, such as gmsh, is loaded once
        importlib.import_module(name)
    pick = random.Random(seed)
    faces = [
        name
        for name, module in ((name, sys.modules[name]) for name in names)
        if {"__all__", "__path__"} <= vars(module).keys() and module.__name__ == name  # no second names
    ]
    pairs = []
    for turn in range(rounds):  # any two, and each second time a module and the face of its package
        first, second = pick.sample(names, 2)
        if turn % 2:
            second = faces[turn // 2 % len(faces)]
            first = pick.choice([name for name in names if name.startswith(f"{second}.")])
        pairs.append((first, second))
    gc.freeze()  # what stays is not looked at for garbage
    turns = Turns()
    sys.meta_path.insert(0, turns)
    for pair in pairs:
        for what in together(pair, turns):
            print(f"{' and '.join(pair)}: {what}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
