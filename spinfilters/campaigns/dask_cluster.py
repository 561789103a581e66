"""Runs on Dask: threads of this process on one machine, or the workers of a scheduler.

Dask hands out chunks of runs. A thread of a Dask worker makes those of its chunk in a process that it keeps for the next
(`RunProcess`), and logs each row as an event, which comes to the client at once; the result of the task itself is empty.
"""

import json
import logging
import os
import queue
import re
import sys
import time
import uuid
import warnings
from collections import deque
from collections.abc import Collection, Generator, Iterable, Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass
from typing import Any, Final

from dask import config as dask_config
from distributed import Client, LocalCluster, Worker, WorkerPlugin, get_worker

from spinfilters.campaigns.engine import Chunk
from spinfilters.campaigns.run_process import RunProcess
from spinfilters.campaigns.runner import Row
from spinfilters.campaigns.study import Study, study_from
from spinfilters.core.errors import InputError
from spinfilters.io.input_file import reason, value_text

FIRST_COUNT: Final = 10.0
"""Seconds in which a scheduler must answer at first."""
RECOVERY_COUNT: Final = 600.0
"""Seconds that a scheduler may be away before the campaign gives up; what is done is kept."""
AHEAD: Final = 3
"""Chunks per thread of the cluster that are under way."""
TOGETHER: Final = 16
"""Chunks that are handed out at once, at most, so that short runs do not wait for Dask; fewer towards the end."""
CHECKED_EVERY: Final = 2.0
"""Seconds after which the threads of the cluster are counted again, and a scheduler that gives no row is asked."""

UNWATCHED: Final = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "10s",
}
"""Settings of Dask on this machine: its looks at itself, which no page shows here, would take 4 % of a processor."""

PROTOCOLS: Final = ("tcp", "tls", "ucx", "ws", "wss")
"""Protocols of a scheduler's address; tcp where none is given."""
_ADDRESS: Final = re.compile(
    r"(?:(?P<protocol>[A-Za-z]\w*)://)?(?:\[[0-9A-Fa-f:.%]+\]|[\w.-]+):(?P<port>[0-9]{1,9})", re.ASCII
)


@dataclass(frozen=True)
class DaskCluster:
    """Place where runs are made.

    Attributes
    ----------
    address : str or None
        Of a scheduler whose workers make them, such as tcp://host:8786; None for this machine.
    processes : int
        Of this machine, where there is no scheduler.

    Raises
    ------
    InputError
        At construction, what is no address.
    """

    address: str | None = None
    processes: int = 1

    def __post_init__(self) -> None:
        if self.address is not None:
            _require_address(self.address)

    def rows(self, study: Study, chunks: list[Chunk]) -> Generator[Row, None, None]:
        """Rows in the order of completion.

        What a worker or a scheduler that was lost had not answered is handed out again.

        Raises
        ------
        InputError
            Dask cannot start on this machine; no scheduler at the address, or none for `RECOVERY_COUNT`
            seconds; workers that cannot make runs.
        """
        unanswered, patience = {run for chunk in chunks for run in chunk}, FIRST_COUNT
        place = _this_machine(self.processes) if self.address is None else nullcontext(self.address)
        with silent_dask(), place as address:
            while unanswered:
                left = (tuple(run for run in chunk if run in unanswered) for chunk in chunks)
                with _connected(address, patience) as client:
                    for row in _collect_rows(client, study, filter(None, left)):
                        if row["run"] in unanswered:  # not of a chunk that was handed out twice
                            unanswered.discard(row["run"])
                            yield row
                patience = RECOVERY_COUNT


def usable_processors() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


class RunProcesses(WorkerPlugin):
    """Processes of a study that a Dask worker keeps from chunk to chunk, until the campaign or the worker ends.

    Parameters
    ----------
    name : str
        Of this plugin on the workers, and of the topic of its rows.
    study : Study
        Whose runs are made.
    """

    def __init__(self, name: str, study: Study) -> None:
        self.name, self._document = name, json.dumps(dict(study.document))

    def setup(self, worker: Worker) -> None:
        """Prepare on a worker: no process is started before a chunk comes."""
        self._study = study_from(json.loads(self._document), "study")
        self._idle: list[RunProcess] = []
        self._all: list[RunProcess] = []

    def teardown(self, worker: Worker) -> None:
        """End all processes, those with a run under way too."""
        for process in self._all:
            process.stop()

    @contextmanager
    def process(self) -> Iterator[RunProcess]:
        """Provide a process to one thread, and keep it unless an error comes."""
        if self._idle:
            process = self._idle.pop()
        else:
            process = RunProcess(self._study)
            self._all.append(process)
        yield process
        self._idle.append(process)


def make_runs(name: str, chunk: Chunk) -> None:
    """Make some runs in a thread of a Dask worker; every row is an event of the topic ``name``."""
    worker = get_worker()
    kept: Any = worker.plugins[name]
    with kept.process() as process:
        for run in chunk:
            worker.log_event(name, json.dumps(process.row(run)))


def _collect_rows(client: Client, study: Study, chunks: Iterable[Chunk]) -> Iterator[Row]:
    """Rows as they come, a few chunks under way at a time; the end comes early when the scheduler is lost."""
    name = f"spinfilters-{uuid.uuid4().hex}"  # of this campaign alone, where another runs the same study on the same cluster
    waiting, under_way = deque(chunks), set()
    answered: queue.SimpleQueue[Any] = queue.SimpleQueue()  # rows, and after them the future of their chunk
    client.subscribe_topic(name, lambda event: answered.put(json.loads(event[1])))
    try:
        client.register_plugin(RunProcesses(name, study))
    except Exception as error:
        raise _unfit_workers(error) from None
    try:
        most, asked = 0, -CHECKED_EVERY
        while waiting or under_way:
            if time.monotonic() - asked >= CHECKED_EVERY:  # workers come and go
                most, asked = AHEAD * _threads(client), time.monotonic()
            while waiting and len(under_way) < most:
                count = max(1, min(TOGETHER, len(waiting) // (2 * most)))
                taken = tuple(run for _ in range(count) for run in waiting.popleft())
                future = client.submit(make_runs, name, taken, pure=False)
                under_way.add(future)
                future.add_done_callback(answered.put)
            try:
                answer = answered.get(timeout=CHECKED_EVERY)
            except queue.Empty:
                _require_scheduler(client, under_way)
                continue
            if isinstance(answer, dict):
                yield answer
            else:
                under_way.discard(answer)
                _require_no_error(answer)
    except _SchedulerLostError:
        return
    finally:
        _end_runs(client, name, under_way)


def _end_runs(client: Client, name: str, under_way: Collection[Any]) -> None:
    """Take back the chunks that are under way, and let the workers end their processes."""
    with suppress(Exception):
        if client.status == "running":
            client.cancel(list(under_way))
            client.unregister_worker_plugin(name)


def _require_no_error(future: Any) -> None:
    """InputError: the task of a chunk failed, but not because its worker or scheduler was lost."""
    if future.status != "error":
        return
    error = future.exception(timeout=10)
    if isinstance(error, InputError):
        raise InputError(str(error))
    if type(error).__name__ not in ("KilledWorker", "CancelledError"):
        raise _unfit_workers(error)


def _unfit_workers(error: Exception) -> InputError:
    return InputError(
        f"the cluster's workers cannot make runs ({type(error).__name__}: {reason(error)}); install the same "
        "spinfilters[campaign] for them"
    )


class _SchedulerLostError(Exception):
    """The scheduler is gone, or has forgotten what it was given."""


def _require_scheduler(client: Client, under_way: Collection[Any]) -> None:
    """_SchedulerLostError unless the scheduler answers and still knows what is under way."""
    if client.status != "running" or any(future.status in ("cancelled", "lost") for future in under_way):
        raise _SchedulerLostError
    try:
        client.scheduler_info(n_workers=0)
    except Exception as error:
        raise _SchedulerLostError from error


def _threads(client: Client) -> int:
    """Number of threads of all workers, at least one."""
    with suppress(Exception):
        threads: Any = client.nthreads()
        return max(1, sum(threads.values()))
    raise _SchedulerLostError


@contextmanager
def _this_machine(processes: int) -> Iterator[str]:
    """Address of a scheduler in this process, whose one worker has a thread for each process of runs.

    Nothing of Dask listens to other machines. InputError: it cannot start, as where sockets are forbidden.
    """
    own_page = "127.0.0.1:0"  # scheduler and worker insist on one
    try:
        with warnings.catch_warnings(), dask_config.set(UNWATCHED):
            warnings.simplefilter("ignore")  # a machine without a network has no address: none is needed
            cluster: Any = LocalCluster(
                n_workers=1,
                threads_per_worker=processes,
                processes=False,
                memory_limit=0,  # this process's memory is not Dask's to judge
                dashboard_address=own_page,
                scheduler_kwargs={"dashboard": False},  # no page that needs bokeh
                worker_dashboard_address=own_page,
                silence_logs=logging.CRITICAL,
            )
    except (OSError, RuntimeError) as error:
        raise InputError(
            f"Dask cannot start on this machine ({reason(error)}); allow sockets of 127.0.0.1 and a temporary folder, "
            "or give a cluster with --scheduler"
        ) from None
    try:
        yield cluster.scheduler_address
    finally:
        with suppress(Exception):
            cluster.close(timeout=10)


@contextmanager
def _connected(address: str, patience: float) -> Iterator[Client]:
    """A client, closed afterwards. InputError: no scheduler answers in time."""
    client = _client(address, patience)
    try:
        yield client
    finally:
        with suppress(Exception):
            client.close(timeout=2)


def _client(address: str, patience: float) -> Client:
    begin, why = time.monotonic(), ""
    while time.monotonic() - begin < patience:
        try:
            return Client(address, timeout="5s", set_as_default=False)
        except ValueError as error:
            raise _no_address(address, reason(error)) from None
        except OSError as error:
            why = reason(error)
        time.sleep(1.0)
    raise InputError(
        f"no Dask scheduler answers at {value_text(address)} ({why}); start 'dask scheduler', or continue with --resume"
    )


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
def silent_dask() -> Iterator[None]:
    """Drop what Dask logs, and what its destroyed objects complain of, as a client that never connected.

    Of a lost scheduler and of workers that fail the campaign speaks itself.
    """
    logger, before = logging.getLogger("distributed"), sys.unraisablehook
    level = logger.level

    def hook(found: Any) -> None:
        """Complaints of everybody else, as before."""
        origin = getattr(found.object, "__module__", None) or ""
        if origin.partition(".")[0] not in _OF_DASK:
            before(found)

    logger.setLevel(logging.CRITICAL)
    sys.unraisablehook = hook
    try:
        yield
    finally:
        sys.unraisablehook = before
        logger.setLevel(level)
