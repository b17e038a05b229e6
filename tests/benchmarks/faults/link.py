"""A simulated network: named hosts, each a namespace with one Ethernet device, connected by cables with faults.

Replaces Linux's netem, which not every kernel includes. A thread switches frames between tap devices; each host's cable may be
cut, delayed, jittery, slow, or lose frames.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import heapq
import itertools
import os
import random
import select
import struct
import subprocess
import threading
import time
from dataclasses import dataclass, field

__all__ = ["Cable", "Network"]

TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
CLONE_NEWNET = 0x40000000
FRAME = 65536
QUEUE_S = 2.0  # frames that would wait longer for a slow cable are lost


@dataclass
class Cable:
    """Quality of a host's cable, equal in both directions. rate: bytes per second; None: unlimited."""

    is_cut: bool = False
    delay_s: float = 0.0
    uneven_s: float = 0.0  # random additional delay up to this, so that frames overtake each other
    loss: float = 0.0
    rate: float | None = None
    busy_until: float = field(default=0.0, compare=False)


class Network:
    """Simulated network of hosts that reach each other and this machine; a context manager that needs root."""

    def __init__(self, prefix: str, hosts: list[str]) -> None:
        """Creates the network. prefix: start of the namespaces' names, at most six letters. hosts: names of the hosts."""
        self.prefix = prefix
        part = random.SystemRandom().randrange(1, 250)
        self.here = f"10.197.{part}.254"
        self.addresses = {name: f"10.197.{part}.{i}" for i, name in enumerate(hosts, 1)}
        self.cables = {name: Cable() for name in hosts}
        self._by_fd: dict[int, Cable] = {}
        self._known: dict[bytes, int] = {}  # MAC address -> file descriptor of its tap device
        self._late: list[tuple[float, int, int, bytes]] = []
        self._number = itertools.count()
        self._draw = random.Random(1)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="switch", daemon=True)

    def namespace(self, host: str) -> str:
        """Returns the name of a host's namespace."""
        return f"{self.prefix}-{host}"

    def inside(self, host: str) -> list[str]:
        """Returns the start of a command line that runs the rest of the line on this host."""
        return ["ip", "netns", "exec", self.namespace(host)]

    def __enter__(self) -> Network:
        for host, address in self.addresses.items():
            name = self.namespace(host)
            _ip("netns", "add", name)
            self._by_fd[_tap("eth0", name)] = self.cables[host]
            for words in (
                ["addr", "add", f"{address}/24", "dev", "eth0"],
                ["link", "set", "eth0", "up"],
                ["link", "set", "lo", "up"],
            ):
                _ip("-n", name, *words)
        device = f"{self.prefix}-here"
        self._by_fd[_tap(device, None)] = Cable()
        _ip("addr", "add", f"{self.here}/24", "dev", device)
        _ip("link", "set", device, "up")
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(5)
        for fd in self._by_fd:
            os.close(fd)
        for host in self.addresses:
            _ip("netns", "delete", self.namespace(host))

    def _run(self) -> None:
        poll = select.poll()
        for fd in self._by_fd:
            poll.register(fd, select.POLLIN)
        while not self._stop.is_set():
            wait_s = min(max(self._late[0][0] - time.monotonic(), 0.0), 0.1) if self._late else 0.1
            for fd, _ in poll.poll(wait_s * 1000):
                self._take(fd)
            now = time.monotonic()
            while self._late and self._late[0][0] <= now:
                _, _, fd, frame = heapq.heappop(self._late)
                _write(fd, frame)

    def _take(self, source: int) -> None:
        for _ in range(64):
            try:
                frame = os.read(source, FRAME)
            except OSError:
                return
            self._known[frame[6:12]] = source
            target = self._known.get(frame[:6])
            for fd in [target] if target is not None else self._by_fd:
                if fd != source:
                    self._pass_on(frame, source, fd)

    def _pass_on(self, frame: bytes, source: int, target: int) -> None:
        now = time.monotonic()
        at = now
        for cable in (self._by_fd[source], self._by_fd[target]):
            if cable.is_cut or (cable.loss and self._draw.random() < cable.loss):
                return
            at += cable.delay_s + (self._draw.random() * cable.uneven_s if cable.uneven_s else 0.0)
            if cable.rate is not None:
                cable.busy_until = max(now, cable.busy_until) + len(frame) / cable.rate
                at = max(at, cable.busy_until)
        if at <= now:
            _write(target, frame)
        elif at - now < QUEUE_S:
            heapq.heappush(self._late, (at, next(self._number), target, frame))


def _write(fd: int, frame: bytes) -> None:
    with contextlib.suppress(OSError):  # the queue is full or the host is down: Ethernet drops the frame
        os.write(fd, frame)


def _tap(name: str, namespace: str | None) -> int:
    """Returns the non-blocking file descriptor of a new tap device.

    Runs in a thread of its own, since a network namespace belongs to a thread.
    """
    made: list[int] = []

    def make() -> None:
        if namespace is not None:
            fd = os.open(f"/run/netns/{namespace}", os.O_RDONLY | os.O_CLOEXEC)
            if ctypes.CDLL(None, use_errno=True).setns(fd, CLONE_NEWNET):
                raise OSError(ctypes.get_errno(), "setns")
            os.close(fd)
        fd = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)
        fcntl.ioctl(fd, TUNSETIFF, struct.pack("16sH22x", name.encode(), IFF_TAP | IFF_NO_PI))
        made.append(fd)

    thread = threading.Thread(target=make)
    thread.start()
    thread.join()
    if not made:
        raise OSError(f"no network device {name} can be made here")
    return made[0]


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, stdout=subprocess.DEVNULL)
