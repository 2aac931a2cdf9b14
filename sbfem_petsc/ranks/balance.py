"""Independent items of work over the ranks: a rank that has finished takes over some of another's."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple, TypeVar

from mpi4py import MPI

from .parallel import collective, packed, unpacked, wait_until

# Tags of messages: "have you work for me?", the answer to it, and results on their way to the items' owner.
_ASK, _GIVE, _REPORT = 29_877, 29_878, 29_879
# Of many ranks only so many are asked, the next ones: an answer takes as long as an item.
_ASKED = 8
# Items given away at a time: results wait on the rank that has made them, and go back in one message.
_MOST = 64

Item = TypeVar("Item")
Result = TypeVar("Result")


class _Batch(NamedTuple):
    """Items of one rank that are still to be done, with their numbers there, in ascending order."""

    owner: int
    items: deque[tuple[int, Any]]


class _Report(NamedTuple):
    """What a rank has made of items: how many are settled, results by number, those of another rank's items
    pickled, and what ended the work.
    """

    settled: int
    results: dict[int, Any]
    failure: tuple[int, Any] | None


def balanced(comm: MPI.Comm, items: Iterable[Item], work: Callable[[Item], Result]) -> list[Result]:
    """`work` of each of this rank's items, in their order, by this rank or by one that had none left.
    Collective.

    Items and results travel as pickles. What is given away is half of what is left, 64 items at most, and
    results go back together: few messages, and a wait of about an item at the end.

    Parameters
    ----------
    comm : Comm
    items : iterable
        This rank's; such as can be pickled.
    work : callable
        The same on all ranks; must not communicate.

    Raises
    ------
    Exception
        What `work`, or pickling its result, has raised of the first such item of the lowest rank; on all
        ranks.
    """
    if comm.size == 1:
        with collective(comm):
            return [work(item) for item in items]
    # all ranks are here, or one would ask another that never answers
    with collective(comm):
        exchange = _Exchange(comm, list(items), work)
    exchange.run()
    with collective(comm):
        return exchange.results()


class _Exchange:
    """Batches of items on their way between the ranks of a communicator.

    No message is left over at the end: a rank enters the last barrier when every question of its own is
    answered and every result of its items is there, and answers the others until all have entered it.
    """

    def __init__(self, comm: MPI.Comm, items: list, work: Callable[[Any], Any]):
        self.comm, self.work = comm, work
        self.length = self.missing = len(items)
        self.batch = _Batch(comm.rank, deque(enumerate(items)))
        self.found: dict[int, Any] = {}
        self.failures: list[tuple[int, Exception]] = []
        self.sent: list[MPI.Request] = []

    def run(self) -> None:
        """Work off this rank's items, then what the others give."""
        comm = self.comm
        self._work_off()
        place, refused = 0, 0
        others = [(comm.rank + k) % comm.size for k in range(1, min(comm.size, _ASKED + 1))]
        while refused < len(others):
            self.batch = self._ask(others[place])
            if self.batch.items:
                refused = 0
                self._work_off()
            else:
                place, refused = (place + 1) % len(others), refused + 1
        self._wait(self._complete)
        barrier = comm.Ibarrier()
        self._wait(barrier.Test)
        MPI.Request.Waitall(self.sent)

    def results(self) -> list:
        """Of this rank's items; what was raised first of them."""
        if self.failures:
            raise min(self.failures, key=lambda failure: failure[0])[1]
        return [self.found[number] for number in range(self.length)]

    def _work_off(self) -> None:
        """Do what is left of the batch after others have been given of it, and report."""
        owner, items = self.batch
        own = owner == self.comm.rank
        count, results, failure = 0, {}, None
        while items:
            self._answer()
            number, item = items.popleft()
            count += 1
            try:
                found = self.work(item)
                # a result that cannot travel must not end this rank's part in the exchange
                results[number] = found if own else MPI.pickle.dumps(found)
            except Exception as error:
                failure = (number, error)
                count += len(items)
                items.clear()
        if own:
            self._settle(_Report(count, results, failure))
        else:
            told = None if failure is None else (failure[0], packed(failure[1]))
            self._send(_Report(count, results, told), owner, _REPORT)

    def _ask(self, other: int) -> _Batch:
        """What another rank gives."""
        self._send(None, other, _ASK)
        self._wait(lambda: self.comm.Iprobe(source=other, tag=_GIVE))
        given: _Batch = self.comm.recv(source=other, tag=_GIVE)
        return given

    def _answer(self) -> None:
        """Give those who ask half of what is left, from its end."""
        status = MPI.Status()
        while self.comm.Iprobe(source=MPI.ANY_SOURCE, tag=_ASK, status=status):
            self.comm.recv(source=status.source, tag=_ASK)
            owner, items = self.batch
            given = [items.pop() for _ in range(min(len(items) // 2, _MOST))]
            self._send(_Batch(owner, deque(reversed(given))), status.source, _GIVE)

    def _complete(self) -> bool:
        """Whether nothing of this rank's is under way any more."""
        status = MPI.Status()
        while self.comm.Iprobe(source=MPI.ANY_SOURCE, tag=_REPORT, status=status):
            count, results, told = self.comm.recv(source=status.source, tag=_REPORT)
            failure = None if told is None else (told[0], unpacked(told[1]))
            found = {number: MPI.pickle.loads(result) for number, result in results.items()}
            self._settle(_Report(count, found, failure))
        return self.missing == 0 and MPI.Request.Testall(self.sent)

    def _settle(self, report: _Report) -> None:
        self.missing -= report.settled
        self.found.update(report.results)
        if report.failure is not None:
            self.failures.append(report.failure)

    def _wait(self, done: Callable[[], bool]) -> None:
        """Until `done` says so, answering those who ask."""

        def answered_and_done() -> bool:
            self._answer()
            return done()

        wait_until(self.comm, answered_and_done)

    def _send(self, message: Any, other: int, tag: int) -> None:
        """Without waiting for the other rank, which may be sending to this one."""
        self.sent.append(self.comm.isend(message, dest=other, tag=tag))
