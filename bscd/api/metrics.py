"""Figures for Prometheus: the rig's from its status, the API's as they come."""

from __future__ import annotations

import time
from collections.abc import Iterator

from prometheus_client import CollectorRegistry, Counter, Histogram, generate_latest
from prometheus_client.metrics_core import GaugeMetricFamily, Metric
from prometheus_client.registry import Collector
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from bscd.daemon.daemon import Daemon
from bscd.daemon.documents import RigState, StatusDocument


class RigFigures(Collector):
    """The status as gauges, made when they are asked for."""

    def __init__(self, daemon: Daemon) -> None:
        self._daemon = daemon

    def describe(self) -> list[Metric]:
        """Nothing before the rig is there."""
        return []

    def collect(self) -> Iterator[Metric]:
        """The gauges now."""
        status = self._daemon.status()
        states = GaugeMetricFamily("bscd_state", "1 for the state that the rig is in", labels=["state"])
        for state in RigState:
            states.add_metric([state.value], float(status.state is state))
        yield states
        connected = GaugeMetricFamily("bscd_device_connected", "1 for a device that answers", labels=["device"])
        for name, device in status.devices.items():
            connected.add_metric([name], float(device.connected))
        yield connected
        for name, told, value in _plain(status):
            if value is not None:
                yield GaugeMetricFamily(name, told, value=float(value))


def _plain(status: StatusDocument) -> Iterator[tuple[str, str, float | None]]:
    job, live = status.job, status.live
    yield "bscd_estop_latched", "1 while the e-stop is latched", float(status.estop.latched)
    yield "bscd_queue_jobs", "jobs that wait for the bench", len(status.queue)
    yield "bscd_desk_jobs", "jobs at the desk and in line for it", len(status.desk)
    yield "bscd_disk_free_bytes", "free on the data folder's disk", status.disk_free_bytes
    yield "bscd_pressure_kpa", "gauge pressure", status.pressure_kpa
    if job is not None and job.progress is not None and job.progress.total:
        yield "bscd_job_share", "how far the job on the bench is, 0 to 1", job.progress.done / job.progress.total
    if live is not None:
        yield "bscd_live_latency_seconds", "from exposure to map of the last live frame", live.latency_s
        yield "bscd_live_valid_points", "points of the last live frame", live.valid


class RequestFigures:
    """Counts requests and how long they took to be answered, by route."""

    def __init__(self, app: ASGIApp, registry: CollectorRegistry) -> None:
        self._app = app
        self._count = Counter("bscd_requests", "requests answered", ["method", "route", "status"], registry=registry)
        self._duration = Histogram("bscd_request_seconds", "until the answer begins", ["route"], registry=registry)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass it on and count it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        begun_s = time.perf_counter()

        async def counted(message: Message) -> None:
            if message["type"] == "http.response.start":
                route = getattr(scope.get("route"), "path", "other")
                self._count.labels(scope["method"], route, str(message["status"])).inc()
                self._duration.labels(route).observe(time.perf_counter() - begun_s)
            await send(message)

        await self._app(scope, receive, counted)


def text_of(registry: CollectorRegistry) -> bytes:
    """In Prometheus' own format."""
    return generate_latest(registry)
