"""Encodes one message of each kind, to be compared with tests/protocol/recorded.json, encoded by an earlier release."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from protocol import contract
from protocol.blends import blender_queue
from protocol.contract import (
    BlobRef,
    DenoiseFrame,
    FrameVectors,
    Manifest,
    PrepareFrames,
    RenderBatch,
    Result,
    ShowEnvironment,
    WorkerReport,
)
from protocol.explained import EXPLAIN, ExplainPixel, explained_key
from protocol.joint import HELP, RENDER_JOINTLY, JointBatch, Piece, Run, help_queue
from protocol.lifeline import lifeline
from protocol.result_bytes import result_bytes
from protocol.site import SiteReport, secret_key, signature, site_key, size_signature
from protocol.sums import pack_sums
from protocol.terms import Offer, Terms, needs_queue, offer_key, terms_key
from protocol.view_parts import (
    RENDER_VIEW,
    VIEW_ANSWERS,
    VIEW_FRAME,
    Part,
    ViewAnswer,
    ViewFrame,
    ViewParts,
    view_key,
    view_queue,
)
from protocol.vitals import Vitals, log_key, log_wanted_key, vitals_key
from renderer.settings import RenderSettings, Tile, View

__all__ = ["LIGHT", "encoded_messages"]

LIGHT = np.random.default_rng(7).gamma(1.0, 2.0, (3, 5, 3)).astype(np.float32)
NAMES = ("PREPARE", "PREPARE_FRAMES", "RENDER_BATCH", "RENDER_BATCHES", "DENOISE", "VECTORS", "ENVIRONMENT", "RESULTS")
MORE = ("WORKER_KEYS", "VERSION_HEADER", "SAMPLES_HEADER")


def _without_settings(message: dict[str, Any]) -> dict[str, Any]:
    """Returns the message with its settings replaced by a constant, since each release adds fields to the settings."""
    return {name: "SETTINGS" if name == "settings" else value for name, value in message.items()}


def encoded_messages() -> dict[str, Any]:
    """Returns one encoded message of each kind that the service and workers exchange, by name; bytes are in hexadecimal."""
    settings = RenderSettings(8, 6, View((0.0, 0.0, 5.0), (0.0, 0.0, 0.0)))
    blob = BlobRef("a/b.obj", "0" * 64, 12, (("1" * 64, 3),))
    batch = RenderBatch("b1", "j1", 3, "c" * 64, Tile(0, 0, 8, 6), 16, 4, settings, 2)
    shutter = {"shutter": 0.5}
    frames = PrepareFrames("w1", "j1", "s1", [2, 3], "d" * 64, {"eye": [0, 1, 2]}, 24.0, "walk", "front", None, 4.0, shutter)
    joint = JointBatch(batch, (Piece("p1", 16, 2), Piece("p2", 18, 2)), 1.5, "q", Run("attic", 16, 8, 2.0)).to_json()
    slots: list[dict[str, Any]] = [{}, {"scene": "s"}]
    report = WorkerReport("attic-1", "attic", 12, 4, "a cpu", "0.2-abc", "ready", 1000.5, 2.5, slots, True, in_hand=["m1"])
    terms = Terms("Mon-Fri 19:00-07:00", 5.0, 10, 2, 10**9, ("q1",))
    result = Result({"type": "batch", "batch": "b1"}, b"SUMS")
    sums = np.zeros((4, 2, 3), np.int64)
    sums[1] = sums[2] = np.arange(6).reshape(2, 3) * 100
    sums[3] = 7
    found = {
        "blob_ref": asdict(blob),
        "manifest": Manifest("s1", "a.obj", [blob], "sky", None, None).to_json(),
        "render_batch": _without_settings(batch.to_json()),
        "joint_batch": {**joint, "whole": _without_settings(joint["whole"])},
        "prepare_frames": frames.to_json(),
        "denoise": DenoiseFrame("w", "j", 0, 8, 6).to_json(),
        "vectors": FrameVectors("w", "j", 0, "s", 8, 6, {}).to_json(),
        "environment": asdict(ShowEnvironment("w", "e", "sky.hdr", "0" * 64, 9, 64)),
        "view_parts": _without_settings(
            ViewParts("m", "w", 3, "c" * 64, settings, [Part(1, Tile(0, 0, 4, 4), 0, 2)], True).to_json()
        ),
        "view_frame": ViewFrame("m", "w", 3, frames).to_json(),
        "explain": _without_settings(ExplainPixel("m", "j", "c" * 64, settings, 1, 2, 64, 5, frames).to_json()),
        "worker_report": report.to_bytes(),
        "terms": terms.to_bytes(),
        "terms_digest": terms.digest,
        "offer": Offer(("gpu",), 10**9, 4, "0" * 16).to_bytes(),
        "vitals": Vitals(5, 10).to_bytes(),
        "site_report": SiteReport("attic", "host", 1, "10.0.0.1", 8700, 1000.0, ["b1"], 3, 2, 100, 50).to_bytes(),
        "signature": signature(b"secret", b"body"),
        "announced": size_signature(b"secret", 4),
        "view_answer": ViewAnswer("part", "w", 3, "m", "attic-1", {"number": 1, "seconds": 0.5}, b"SUMS").to_bytes(),
        "result_bytes": result_bytes(result),
        "result_fields": {name.decode(): value.decode() for name, value in result.to_fields().items()},
        "sums": pack_sums(sums),
        "sums_old": pack_sums(sums, 1),
        "names": {name: getattr(contract, name) for name in NAMES + MORE}
        | {"RENDER_JOINTLY": RENDER_JOINTLY, "HELP": HELP, "RENDER_VIEW": RENDER_VIEW, "VIEW_FRAME": VIEW_FRAME}
        | {"VIEW_ANSWERS": VIEW_ANSWERS, "EXPLAIN": EXPLAIN},
        "keys": [
            *(contract.prepare_queue("k"), contract.own_prepare_queue("k", "w"), contract.render_queue("k")),
            *(contract.denoise_queue("k"), contract.worker_key("w"), contract.pause_key("w"), help_queue("w"), view_queue("k")),
            *(view_key("w"), explained_key("m"), site_key("a"), secret_key("a"), needs_queue("k", "gpu"), terms_key("w")),
            *(offer_key("w"), vitals_key("w"), log_key("w"), log_wanted_key("w"), lifeline("w"), blender_queue("k")),
        ],
    }
    return {name: value.hex() if isinstance(value, bytes) else value for name, value in found.items()}
