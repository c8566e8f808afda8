"""Workers of a Dask scheduler: on this machine, on a cluster, in a cloud."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator, Iterable
from types import TracebackType
from typing import Any

from phcontrol._version import __version__
from phcontrol.sweeps.engine import EngineError, Finished

_EVERY = 5.0  # how often the workers are counted [s]
_AHEAD = 2  # tasks for each thread that are on their way


class DaskScheduler:
    """An :class:`Engine`: tasks on the workers of a Dask scheduler (extra ``phcontrol[cluster]``).

    A task whose worker dies is begun again elsewhere by Dask. Workers that come later are used, too.

    Args:
        address: of the scheduler, like ``tcp://host:8786``.
        timeout: how long it may take to answer [s].

    Raises:
        EngineError: Dask is not installed, nobody answers there, there is no worker, or a worker has another version
            of phcontrol, or none.

    Example:
        >>> from distributed import LocalCluster
        >>> from phcontrol import DaskScheduler
        >>> with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None) as cluster:
        ...     with DaskScheduler(cluster.scheduler_address) as engine:
        ...         sorted(done.value for done in engine.run(len, ["a", "bc"]))
        [1, 2]
    """

    def __init__(self, address: str, *, timeout: float = 10.0) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            raise EngineError("Dask is not installed: pip install 'phcontrol[cluster]'") from error
        try:
            self._client = Client(address, timeout=timeout, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            reason = str(error).splitlines()[0] if str(error) else type(error).__name__
            raise EngineError(
                f"no Dask scheduler answers at {address}: {reason}. Start one with 'dask scheduler', and give the "
                "address that it prints"
            ) from error
        try:
            self._check_workers(address, timeout)
        except BaseException:
            self._client.close()
            raise

    def _check_workers(self, address: str, timeout: float) -> None:
        from distributed import TimeoutError as TookTooLong

        try:
            self._client.wait_for_workers(1, timeout=timeout)
        except TookTooLong as error:
            message = f"the scheduler at {address} has no worker: start some with 'dask worker {address} --nthreads 1'"
            raise EngineError(message) from error
        # a function of no module, which a worker without phcontrol can run, too
        version = lambda: __import__("phcontrol._version", fromlist=["_"]).__version__  # noqa: E731
        found = self._client.run(version, on_error="return")
        for worker, theirs in found.items():
            if theirs != __version__:
                has = f"phcontrol {theirs}" if isinstance(theirs, str) else f"no phcontrol ({theirs})"
                raise EngineError(f"the worker {worker} has {has}, and this is {__version__}: install the same on all")
        threads = self._client.nthreads()
        self.workers = max(1, sum(threads.values()))

    def run(self, task: Callable[[Any], Any], items: Iterable[Any]) -> Generator[Finished, None, None]:
        """Yield what came of ``task(item)`` of each item, as they finish."""
        from distributed import as_completed

        waiting = iter(items)
        given: dict[Any, Any] = {}
        running = as_completed(with_results=True, raise_errors=False, loop=self._client.loop)
        window, asked = 0, -math.inf

        def more() -> None:
            nonlocal window, asked
            if time.monotonic() - asked > _EVERY:  # workers come and go
                threads = sum(self._client.nthreads().values())
                window, asked = _AHEAD * max(1, threads), time.monotonic()
            while len(given) < window:
                item = next(waiting, given)
                if item is given:
                    return
                future = self._client.submit(task, item, pure=False)
                given[future] = item
                running.add(future)

        try:
            more()
            while given:
                future, result = next(running)
                item = given.pop(future)
                if future.status == "finished":
                    found = Finished(item, result, None)
                elif future.status == "error":
                    error = result[1]
                    ours = type(error).__module__.partition(".")[0] != "distributed"  # no KilledWorker, or its like
                    found = Finished(item, None, error if ours else EngineError(" ".join(str(error).split())))
                else:
                    found = Finished(item, None, EngineError(f"Dask has given the task up: {result}"))
                future.release()
                more()
                yield found
        finally:
            self._client.cancel(list(given))

    def close(self) -> None:
        """Leave the scheduler."""
        self._client.close()

    def __enter__(self) -> DaskScheduler:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
