"""Runs on a Dask cluster, one process per worker."""

import json
import logging
import queue
import re
import selectors
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Final

from spinfilters.campaigns.engine import Chunk, WorkerProcess
from spinfilters.campaigns.runner import Row
from spinfilters.campaigns.study import Study, study_from
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import reason, value_text

RECOVERY_COUNT: Final = 600.0
"""Seconds that a scheduler may be away before the campaign gives up; what is done is kept."""
AHEAD: Final = 3
"""Chunks per thread of the cluster that are under way."""
CHECKED_EVERY: Final = 2.0
"""Seconds without a row after which it is looked whether the scheduler is still there."""

PROTOCOLS: Final = ("tcp", "tls", "ucx", "ws", "wss")
"""Of a scheduler's address; tcp where none is given."""
_ADDRESS: Final = re.compile(
    r"(?:(?P<protocol>[A-Za-z]\w*)://)?(?:\[[0-9A-Fa-f:.%]+\]|[\w.-]+):(?P<port>[0-9]{1,9})", re.ASCII
)

_kept = threading.local()


@dataclass(frozen=True)
class DaskCluster:
    """Workers of a scheduler at ``address``, such as tcp://host:8786."""

    address: str

    def rows(self, study: Study, chunks: list[Chunk]) -> Iterator[Row]:
        """Rows in the order of completion.

        A scheduler that comes back is given again what it had not answered.

        Raises
        ------
        InputError
            No scheduler at the address, or none for `RECOVERY_COUNT` seconds.
        """
        logging.getLogger("distributed").setLevel(logging.CRITICAL)  # of a lost scheduler we say so ourselves
        left = dict.fromkeys(chunks)
        client = _connected(self.address, 10.0)
        try:
            while left:
                try:
                    for chunk, rows in _answers(client, study, list(left)):
                        del left[chunk]
                        yield from rows
                except _SchedulerLostError:
                    _close(client)
                    client = _connected(self.address, RECOVERY_COUNT)
        finally:
            _close(client)


class _SchedulerLostError(Exception):
    """The scheduler is gone, or has forgotten what it was given."""


def make_runs(document: str, fingerprint: str, chunk: Chunk) -> str:
    """Rows of some runs as lines of JSON, made in a Dask worker whose process is kept for the next chunk."""
    worker = _process(document, fingerprint)
    worker.assign(chunk)
    rows: list[Row] = []
    try:
        while worker.assigned:
            with selectors.DefaultSelector() as ready:
                ready.register(worker.stream, selectors.EVENT_READ)
                ready.select()
            rows += worker.receive()
    except BaseException:
        _kept.worker = None
        worker.stop()
        raise
    return "\n".join(map(json.dumps, rows))


def _process(document: str, fingerprint: str) -> WorkerProcess:
    """This thread's process for a study."""
    worker: WorkerProcess | None = getattr(_kept, "worker", None)
    if worker is None or _kept.fingerprint != fingerprint:
        if worker is not None:
            worker.stop()
        worker = WorkerProcess(study_from(json.loads(document), "study"))
        _kept.worker, _kept.fingerprint = worker, fingerprint
    return worker


def _answers(client: Any, study: Study, chunks: list[Chunk]) -> Iterator[tuple[Chunk, list[Row]]]:
    """Chunks with their rows as they arrive, a few under way at a time; _SchedulerLostError if some never do."""
    document, waiting = json.dumps(dict(study.document)), iter(chunks)
    under_way: dict[Any, Chunk] = {}
    answered: queue.SimpleQueue[Any] = queue.SimpleQueue()
    while True:
        for chunk in waiting if len(under_way) < AHEAD * _threads(client) else ():
            future = client.submit(
                make_runs, document, study.fingerprint, chunk, key=_key(study, chunk), pure=False, retries=10
            )
            under_way[future] = chunk
            future.add_done_callback(answered.put)
            if len(under_way) >= AHEAD * _threads(client):
                break
        if not under_way:
            return
        try:
            future = answered.get(timeout=CHECKED_EVERY)
        except queue.Empty:
            _require_scheduler(client, under_way)
            continue
        if future in under_way:
            yield under_way.pop(future), _rows_of(future)


def _rows_of(future: Any) -> list[Row]:
    if future.status != "finished":
        error = future.exception(timeout=10) if future.status == "error" else None
        if error is not None and type(error).__name__ not in ("KilledWorker", "CancelledError"):
            raise InputError(
                f"the cluster's workers cannot make runs ({type(error).__name__}: {reason(error)}); install the same "
                "spinfilters[campaign] for them"
            )
        raise _SchedulerLostError
    try:
        text = future.result(timeout=60)
    except Exception as error:
        raise _SchedulerLostError from error
    future.release()
    return [json.loads(line) for line in text.split("\n")]


def _require_scheduler(client: Any, under_way: Mapping[Any, Chunk]) -> None:
    """_SchedulerLostError unless the scheduler answers and still knows what is under way."""
    if client.status != "running" or any(future.status in ("cancelled", "lost") for future in under_way):
        raise _SchedulerLostError
    try:
        client.scheduler_info(n_workers=0)
    except Exception as error:
        raise _SchedulerLostError from error


def _threads(client: Any) -> int:
    """Number of threads of all workers, at least one."""
    with suppress(Exception):
        return max(1, sum(client.nthreads().values()))
    raise _SchedulerLostError


def _key(study: Study, chunk: Chunk) -> str:
    return f"spinfilters-{study.fingerprint}-{chunk[0]}-{len(chunk)}-{time.monotonic_ns()}"


def _connected(address: str, patience: float) -> Any:
    """A client. InputError: no address, or no scheduler answers in time."""
    begin, why = time.monotonic(), ""
    _require_address(address)
    while time.monotonic() - begin < patience:
        try:
            with _silent_finalisers():
                return _client(address)
        except ValueError as error:
            raise _no_address(address, reason(error)) from None
        except OSError as error:
            why = reason(error)
        time.sleep(1.0)
    raise InputError(
        f"no Dask scheduler answers at {value_text(address)} ({why}); start 'dask scheduler', or go on with --resume"
    )


def _client(address: str) -> Any:
    from distributed import Client

    return Client(address, timeout="5s", set_as_default=False)


def _require_address(address: str) -> None:
    """InputError: no [PROTOCOL://]HOST:PORT. A client made of anything else complains on its own when it is destroyed."""
    if address.startswith("inproc://"):  # a cluster of this very process
        return
    found = _ADDRESS.fullmatch(address)
    if found is None:
        raise _no_address(address, "it has no host and port")
    if found["protocol"] not in (None, *PROTOCOLS):
        raise _no_address(address, f"its protocol is none of {', '.join(PROTOCOLS)}")
    if not 0 < int(found["port"]) < 65536:
        raise _no_address(address, "ports are 1 to 65535")


def _no_address(address: str, why: str) -> InputError:
    return InputError(f"scheduler {value_text(address)} is no address ({why}); give tcp://HOST:PORT")


_OF_DASK: Final = ("asyncio", "dask", "distributed", "tornado")
"""Packages of a client and of the loop that it runs in."""


@contextmanager
def _silent_finalisers() -> Iterator[None]:
    """Drop what Dask's destroyed objects complain of: a client that never connected cannot be closed in time."""
    before = sys.unraisablehook

    def hook(found: Any) -> None:
        """Complaints of everybody else, as before."""
        origin = getattr(found.object, "__module__", None) or ""
        if origin.partition(".")[0] not in _OF_DASK:
            before(found)

    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before


def _close(client: Any) -> None:
    with suppress(Exception):
        client.close(timeout=2)
