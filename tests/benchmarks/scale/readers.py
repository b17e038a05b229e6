"""Clients that request pictures of a job again and again, each with another exposure; run as a separate process.

The last line of output has the number of answers by HTTP status.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
from collections import Counter

import httpx

__all__ = ["main"]


async def read_all(url: str, job: str, many: int) -> Counter[int]:
    """Runs `many` clients until the process receives a signal; returns the number of answers by HTTP status."""
    answers: Counter[int] = Counter()
    is_over = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, is_over.set)

    async def read(client: httpx.AsyncClient, number: int) -> None:
        while True:
            path = f"/api/jobs/{job}/frames/0/image.png"
            async with client.stream("GET", path, params={"exposure": number / 1000}) as response:
                async for _ in response.aiter_raw():
                    pass
            answers[response.status_code] += 1
            await asyncio.sleep(0.5)

    async with httpx.AsyncClient(base_url=url, timeout=None, limits=httpx.Limits(max_connections=None)) as client:
        readers = [asyncio.create_task(read(client, number)) for number in range(many)]
        await is_over.wait()
        for reader in readers:
            reader.cancel()
        await asyncio.gather(*readers, return_exceptions=True)
    return answers


def main() -> None:
    """Parses the command line and runs the clients."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--url", required=True)
    parser.add_argument("--job", required=True)
    parser.add_argument("--readers", type=int, required=True)
    o = parser.parse_args()
    print(json.dumps(asyncio.run(read_all(o.url, o.job, o.readers))), flush=True)


if __name__ == "__main__":
    main()
