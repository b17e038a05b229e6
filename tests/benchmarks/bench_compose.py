"""Runs the services of docker-compose.yml without Docker: three workers, one killed while a job renders, one joining late.

    python3 farm.py bench compose [--spp 4000]

For machines without Docker. Commands, environment and health checks are read from docker-compose.yml and the Dockerfile. Each
container is a set of namespaces with its own network and host name, without access to the data of the service or of other
containers. Images are not built; the packages are those of this environment. Needs root. The job's digest is compared with the
digest of the same frame rendered alone.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import httpx
import yaml

from rayfarm.client import Client
from rayfarm.local.broker import find_server
from renderer.child_processes import spawn_guard
from tests.benchmarks.faults.frame import SCENE, digest_alone, request
from tests.benchmarks.faults.link import Network
from tests.helpers import ROOT, wait_until

WORKERS = ("worker-1", "worker-2", "worker-3")
PATIENCE_S = 300.0
# A Redis wheel has no redis-cli, so Python sends the ping.
PING = "import redis, sys; sys.exit(not redis.Redis(socket_timeout=2).ping())"


class Containers:
    """Runs the services of docker-compose.yml as processes, each on a simulated host of its own."""

    def __init__(self, folder: Path, network: Network) -> None:
        self.folder = folder
        self.network = network
        self.url = f"http://{network.addresses['service']}:8000"
        values = {"RAYFARM_ALLOWED_HOSTS": json.dumps(["service", "127.0.0.1", network.addresses["service"]])}
        self.services = _substituted(yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"], values)
        self.running: dict[str, subprocess.Popen[bytes]] = {}
        for name in network.addresses:
            hosts = Path("/etc/netns") / network.namespace(name) / "hosts"  # `ip netns exec` mounts this file over /etc/hosts
            hosts.parent.mkdir(parents=True)
            hosts.write_text(
                "".join(f"{address} {host}\n" for host, address in (*network.addresses.items(), ("localhost", "127.0.0.1")))
            )

    def up(self, name: str) -> None:
        """Starts the container with this name."""
        of = name.partition("-")[0]
        about = self.services[of]
        command = [_local_path(word) for word in about.get("command") or _default_command(of)]
        volume = self.folder / ("data" if of == "service" else "scenes")
        volume.mkdir(exist_ok=True)
        environment = {str(key): str(value) for key, value in about.get("environment", {}).items()}
        blobs = Path.home() / ".cache" / "rayfarm" / "blobs"
        blobs.mkdir(parents=True, exist_ok=True)
        if of == "service":
            environment |= {"RAYFARM_DATA": str(volume), "RAYFARM_PRINT_LINK": "true"}
        hidden = f"mount --bind {volume} {blobs}; mount -t tmpfs hidden {self.folder / 'data'}" if of == "worker" else "true"
        script = f"hostname {name}; {hidden}; cd {ROOT}; exec {shlex.join(command)}"
        with (self.folder / f"{name}.log").open("ab") as log:
            self.running[name] = subprocess.Popen(
                [*self.network.inside(name), "unshare", "--uts", "sh", "-c", script],
                env={**os.environ, **environment},
                stdout=log,
                stderr=log,
                start_new_session=True,
                preexec_fn=spawn_guard(),
            )

    def is_healthy(self, name: str) -> bool:
        """Returns whether the container's health check (of docker-compose.yml or the Dockerfile) succeeds."""
        about = self.services[name.partition("-")[0]]
        test = about.get("healthcheck", {}).get("test") or _health_check()
        command = [_local_path(word) for word in test[1:]]
        if command[0] == "redis-cli":
            command = [sys.executable, "-c", PING]
        environment = {**os.environ, **{str(key): str(value) for key, value in about.get("environment", {}).items()}}
        script = f"hostname {name}; exec {shlex.join(command)}"
        asked = [*self.network.inside(name), "unshare", "--uts", "sh", "-c", script]
        return subprocess.run(asked, env=environment, stderr=subprocess.DEVNULL, check=False).returncode == 0

    def wait_for(self, name: str) -> None:
        try:
            wait_until(lambda: self.is_healthy(name), PATIENCE_S, f"{name} is healthy")
        except BaseException:
            print(self.log(name))
            raise
        print(f"{name} is healthy", flush=True)

    def log(self, name: str) -> str:
        return (self.folder / f"{name}.log").read_text(errors="replace")[-3000:]

    def down(self) -> None:
        for process in reversed(self.running.values()):
            process.kill()
            process.wait()
        for name in self.network.addresses:
            shutil.rmtree(Path("/etc/netns") / self.network.namespace(name), ignore_errors=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spp", type=int, default=4000)
    options = parser.parse_args()
    if os.geteuid() != 0:
        raise SystemExit("To make networks one has to be root.")
    with ExitStack() as ends:
        folder = Path(ends.enter_context(tempfile.TemporaryDirectory(prefix="rayfarm-compose-")))
        network = ends.enter_context(Network(f"rc{os.getpid() % 10000}", ["redis", "service", *WORKERS]))
        containers = Containers(folder, network)
        ends.callback(containers.down)
        for name in ("redis", "service", *WORKERS[:2]):
            containers.up(name)
            containers.wait_for(name)
        return 0 if render(containers, options.spp) else 1


def render(containers: Containers, spp: int) -> bool:
    """Renders a job on two workers, kills one and lets a third join; returns whether the digest equals that of an undisturbed
    render.
    """
    with Client(containers.url) as client:
        scene = client.wait_for_scene(client.upload([SCENE]).id).id
        wait_until(lambda: sum(w.state == "ready" for w in client.workers()) == 2, PATIENCE_S, "two workers are ready")
        job = client.submit(scene, **request(spp, seed=0)).id
        wait_until(lambda: client.job(job).progress > 0.1, PATIENCE_S, "the job is under way")
        os.killpg(containers.running[WORKERS[1]].pid, 9)
        print(f"{WORKERS[1]} was killed at {client.job(job).progress:.0%}", flush=True)
        containers.up(WORKERS[2])
        containers.wait_for(WORKERS[2])
        final = client.wait(job, timeout_s=PATIENCE_S)
        history = httpx.get(f"{containers.url}/api/jobs/{job}/history", timeout=20).json()["events"]
        print("; ".join(f"{event['kind']} {event.get('words') or event.get('text') or ''}".strip() for event in history))
        is_right = final.state == "finished" and client.digest(job) == digest_alone(spp, 0)
    print("the digest is that of the frame alone" if is_right else f"THE DIGEST IS ANOTHER ({final.state}: {final.error})")
    return is_right


def _substituted(what: Any, values: dict[str, str]) -> Any:
    """Returns parsed YAML with each ${NAME:-default} replaced, as Docker Compose does. values: environment variables by name."""
    if isinstance(what, dict):
        return {key: _substituted(value, values) for key, value in what.items()}
    if isinstance(what, list):
        return [_substituted(value, values) for value in what]
    return re.sub(r"\$\{(\w+):-([^}]*)\}", lambda found: values.get(found[1], found[2]), what) if isinstance(what, str) else what


def _targets() -> dict[str, str]:
    """Returns the Dockerfile's build stages: the text of each by target name."""
    parts = re.split(r"^FROM \S+ AS (\w+)$", (ROOT / "Dockerfile").read_text(), flags=re.MULTILINE)
    return dict(zip(parts[1::2], parts[2::2], strict=True))


def _default_command(target: str) -> list[str]:
    found = re.findall(r"^CMD (\[.*\])$", _targets()[target], flags=re.MULTILINE)
    command: Any = json.loads(found[-1])
    return [str(word) for word in command]


def _health_check() -> list[str]:
    """Returns the command of the service's health check from the Dockerfile."""
    found = re.search(r"^HEALTHCHECK.*\n\s+CMD (\[.*\])$", _targets()["service"], flags=re.MULTILINE)
    assert found is not None
    return ["CMD", *json.loads(found[1])]


def _local_path(word: str) -> str:
    """Returns the path on this machine of a program that a container's command names."""
    scripts = Path(sys.executable).parent
    return {"python3": sys.executable, "uvicorn": str(scripts / "uvicorn"), "redis-server": str(find_server())}.get(word, word)


if __name__ == "__main__":
    sys.exit(main())
