"""Tests of settings ("terms") that a real worker applies while it runs."""

from __future__ import annotations

import json
import os
from datetime import datetime, timedelta

import psutil
import pytest

from protocol.contract import RENDER_BATCH, SceneInfo, render_queue
from protocol.terms import Offer, Terms, needs_queue, offer_key, terms_key
from tests.helpers import wait_until
from tests.worker.bench import Bench, slots_of
from tests.worker.test_worker import batch_of, bench, info  # noqa: F401 - fixtures


def offer(bench: Bench) -> Offer:  # noqa: F811
    return Offer.from_bytes(bench.store.get(offer_key(bench.report().name)))  # type: ignore


def send_terms(bench: Bench, terms: Terms) -> Offer:  # noqa: F811
    """Sends settings ("terms") to the worker, and waits until the worker applies them; returns its report of them."""
    bench.store.set(terms_key(bench.report().name), terms.to_bytes())  # type: ignore
    wait_until(lambda: offer(bench).keeps == terms.digest, 20, "it keeps what is asked")
    return offer(bench)


@pytest.mark.long
def test_worker_applies_terms_within_seconds_without_losing_batches(bench: Bench, info: SceneInfo) -> None:  # noqa: F811
    first = offer(bench)
    report = bench.report()
    assert report is not None
    assert first.slots_most == report.slots == 2
    assert f"kind:{report.kind.lower()}" in first.tags
    assert first.memory == psutil.virtual_memory().total
    queue = needs_queue(report.kind, "gpu")
    level = first.nice
    now = send_terms(bench, Terms(slots=1, nice=min(level + 2, 19), queues=(queue,)))
    assert (now.nice, now.queues, now.trouble) == (min(level + 2, 19), (queue,), None)
    slots = slots_of(report.pid)
    assert {process.nice() for process in slots} == {now.nice}
    wait_until(lambda: bench.report().slots == 1, 20, "it reports one slot")  # type: ignore

    for i in range(6):
        where = queue if i % 2 else render_queue(report.kind)
        batch = batch_of(info, f"terms-{i}", 8 * i, 8, 256)
        bench.celery.send_task(RENDER_BATCH, kwargs={"batch": batch.to_json()}, queue=where, task_id=batch.batch)
    came = {bench.next("batch").event["batch"] for _ in range(3)}
    tomorrow = (datetime.now() + timedelta(days=2)).strftime("%a")
    rests = send_terms(bench, Terms(hours=tomorrow, queues=(queue,)))
    assert rests.why == f"Outside its hours: {tomorrow}."
    wait_until(lambda: bench.report().state == "paused", 20, "it rests")  # type: ignore
    send_terms(bench, Terms(queues=(queue,)))
    came |= {bench.next("batch").event["batch"] for _ in range(3)}
    assert came == {f"terms-{i}" for i in range(6)}, "what was in hand and what waited"
    wait_until(lambda: bench.report().slots == 2, 20, "it has all its slots again")  # type: ignore
    bench.store.delete(terms_key(report.name))
    wait_until(lambda: offer(bench).queues == (), 20, "it takes from its own queues alone")
    assert json.dumps(offer(bench).trouble) == "null" or os.geteuid() != 0, "only root may lower a nice level"
