"""Viewers of one job, which acknowledge every packet.

The service sends packets in rounds, one after each pause; measured are the intervals between the starts of rounds.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import struct
import time

from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed

__all__ = ["main"]

PAUSE_S = 0.04  # packets closer together than this belong to one round
SEQUENCE = struct.Struct("<4xI")


async def watch(url: str, warm_s: float, seconds: float, rounds: list[float], received: list[int]) -> None:
    """Watches the job as one viewer for `seconds`, after `warm_s` seconds that are not measured.

    The intervals between rounds of packets, in seconds, are appended to `rounds`, and the packets' sizes in bytes to `received`.
    """
    begun = time.monotonic()
    last_packet = last_round = None
    async with connect(url, max_size=None, compression=None) as socket:
        while time.monotonic() < begun + warm_s + seconds:
            try:
                message = await asyncio.wait_for(socket.recv(), 5.0)
            except (TimeoutError, ConnectionClosed):
                continue
            if isinstance(message, str):
                continue
            now = time.monotonic()
            if last_packet is None or now - last_packet > PAUSE_S:
                if last_round is not None and now > begun + warm_s:
                    rounds.append(now - last_round)
                last_round = now
            last_packet = now
            if now > begun + warm_s:
                received.append(len(message))
            await socket.send(json.dumps({"ack": SEQUENCE.unpack_from(message)[0]}))


async def watch_all(url: str, many: int, warm_s: float, seconds: float) -> tuple[list[float], list[int]]:
    """Runs `many` viewers at once; returns (intervals between rounds of packets in seconds, sizes of all packets in bytes)."""
    rounds: list[float] = []
    received: list[int] = []
    await asyncio.gather(*(watch(url, warm_s, seconds, rounds, received) for _ in range(many)))
    return rounds, received


def main() -> None:
    """Runs the viewers; the last line of output has the intervals."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--url", required=True)
    parser.add_argument("--watchers", type=int, required=True)
    parser.add_argument("--warm", type=float, required=True)
    parser.add_argument("--seconds", type=float, required=True)
    o = parser.parse_args()
    rounds, received = asyncio.run(watch_all(o.url, o.watchers, o.warm, o.seconds))
    print(json.dumps({"rounds_s": rounds, "packets": len(received), "bytes": sum(received)}), flush=True)


if __name__ == "__main__":
    main()
