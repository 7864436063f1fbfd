"""The Dask cluster that a campaign works on: one of our own on this machine, or theirs.

Who is there to work is seen by `fg_nav.lab.campaign.crew`, what they do is the matter of `fg_nav.lab.campaign.session`.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeAlias

from fg_nav.errors import CampaignError
from fg_nav.lab.campaign.made import Job
from fg_nav.lab.campaign.parcel import Brought, Parcel, unpacked

EXTRA = "campaign"

DEATHS = 3
"""Workers that a cell may kill."""

PATIENCE_S = 300.0
"""For a scheduler or workers that are gone: a restart takes seconds, a node of a queue minutes."""

Work: TypeAlias = Callable[[Parcel], Brought]
"""What a worker does; `unpacked` but in tests."""

LAST_PORT = 65535

_ADDRESS = re.compile(r"(?P<by>tcp|tls)://(\[[0-9a-fA-F:.%]+\]|[\w.-]+):(?P<port>[0-9]+)")

_OURS = {
    "distributed.scheduler.allowed-failures": DEATHS,  # we count ourselves
    "distributed.worker.memory.target": False,  # nothing is stored there that could be put to disk
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,  # a paused worker would never be given work again
    "distributed.worker.memory.terminate": 0.95,
    # Ctrl-C goes to all processes of a terminal: the campaign ends its workers, which would complain of it
    "distributed.worker.preload": ["import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"],
}
"""Settings of our own cluster."""


def check_installed() -> None:
    """Raise `CampaignError` if Dask or Arrow is not there."""
    try:
        import dask
        import distributed
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise CampaignError(
            f"campaigns need Dask and Arrow, and {error.name} is not there: pip install 'fg-nav[{EXTRA}]'."
        ) from None
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # workers that die are our business
    dask.config.set({"logging.distributed": "critical"})
    del distributed


def check_address(address: str) -> None:
    """Raise `CampaignError` where there can be no scheduler; Dask would tell it by a traceback of its own."""
    from distributed.security import Security

    found = _ADDRESS.fullmatch(address)
    if found is None or int(found["port"]) > LAST_PORT:
        raise CampaignError(f"'{address}' is no address of a Dask scheduler: write it as tcp://host:8786.")
    if found["by"] == "tls" and Security().get_connection_args("client").get("ssl_context") is None:
        raise CampaignError(f"Dask has no certificates for {address}: name them in its configuration, or use tcp.")


@dataclass(frozen=True)
class Cluster:
    """Where the work is done.

    Attributes
    ----------
    scheduler : address, `tcp://host:port`; None for a cluster of our own, as long as the campaign.
    workers : processes of our own cluster, one thread each.
    patience_s : how long to wait for a scheduler or workers that are gone.
    work : what they do.
    """

    scheduler: str | None = None
    workers: int = 1
    patience_s: float = PATIENCE_S
    work: Work = unpacked

    @property
    def far(self) -> bool:
        """Whether the workers may have other disks."""
        return self.scheduler is not None

    def workers_for(self, jobs: Sequence[Job]) -> int:
        """Number of processes of our own that these need: each gets its share of the memory."""
        return max(1, min(self.workers, sum(len(job.keys) for job in jobs)))

    @contextmanager
    def entered(self, jobs: Sequence[Job]) -> Iterator[str]:
        """Yield the scheduler's address, its cluster started for these jobs if it is ours.

        Raises
        ------
        CampaignError
            If there is no scheduler at the address, or no cluster can be started.
        """
        if self.scheduler is not None:
            yield self.scheduler
            return
        import dask
        from distributed import LocalCluster

        with dask.config.set(_OURS):
            try:
                ours = LocalCluster(
                    n_workers=self.workers_for(jobs),
                    threads_per_worker=1,
                    processes=True,
                    host="127.0.0.1",
                    dashboard_address="127.0.0.1:0",
                    silence_logs=logging.CRITICAL,
                )
            except (OSError, RuntimeError) as error:
                raise CampaignError(f"no Dask cluster could be started here ({error}): try fewer --workers.") from None
            with ours:
                yield ours.scheduler_address
