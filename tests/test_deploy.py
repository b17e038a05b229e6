"""Tests of the files for deployment on clusters and clouds, against Kubernetes' schemas and the sources."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from renderer import __version__
from service.settings import Settings
from tests.grids import grid
from worker.__main__ import _options

ROOT = Path(__file__).parents[1]
CLUSTER = ROOT / "deploy" / "kubernetes"
FILES = ("farm/redis", "farm/service", "farm/worker", "gpu/worker", "standby/services")
FOLDERS = (".", "autoscale", "gpu", "standby")
PARTS = [part for file in FILES for part in yaml.safe_load_all((CLUSTER / f"{file}.yaml").read_text())]


@pytest.mark.parametrize("part", PARTS, ids=lambda part: f"{part['kind']}-{part['metadata']['name']}")
@grid("release", ["1.29", "1.34"], ordinary=("1.29",))
def test_kubernetes_manifests_match_their_schemas(part: dict[str, Any], release: str) -> None:
    kubernetes_validate.validate(part, release, strict=True)


@pytest.mark.parametrize("folder", FOLDERS)
def test_overlays_do_not_refer_to_their_parent_folders(folder: str) -> None:
    """No kustomize overlay refers to a folder that contains the overlay itself, which kustomize rejects as a cycle."""
    here = (CLUSTER / folder).resolve()
    for resource in yaml.safe_load((here / "kustomization.yaml").read_text())["resources"]:
        found = (here / resource).resolve()
        assert found.exists(), resource
        assert not here.is_relative_to(found), resource


KEDA = """
import importlib, sys, pydantic, yaml
models = importlib.import_module("cloudcoil.models.keda.v1alpha1")
for path in sys.argv[1:]:
    part = yaml.safe_load(open(path))
    model = getattr(models, part["kind"])
    assert model.model_validate(part).model_dump(by_alias=True, exclude_none=True) == part
    part["spec"] = "none"
    try:
        model.model_validate(part)
    except pydantic.ValidationError:
        continue
    raise AssertionError(path)
"""


@pytest.mark.long  # installs the models
def test_keda_objects_match_their_resource_definitions(tmp_path: Path) -> None:
    """KEDA's typed models accept each object, and know all of its fields: they write it as it was.

    They are installed into an environment of their own, since their package is also a plugin of pytest.
    """
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path)], check=True)
    python = str(tmp_path / "bin" / "python")
    subprocess.run([python, "-m", "pip", "install", "-q", "cloudcoil.models.keda==2.16.1.0", "pyyaml"], check=True)
    files = [str(CLUSTER / "autoscale" / f"{name}.yaml") for name in ("token", "worker-scaling")]
    subprocess.run([python, "-c", KEDA, *files], check=True)


@pytest.mark.skipif(shutil.which("kubectl") is None, reason="needs kubectl")
@pytest.mark.parametrize("folder", FOLDERS)
def test_kubectl_builds_every_overlay(folder: str) -> None:
    made = subprocess.run(["kubectl", "kustomize", str(CLUSTER / folder)], capture_output=True, text=True, check=True)
    parts = list(yaml.safe_load_all(made.stdout))
    services = [part["kind"] for part in parts if part["metadata"]["name"] == "rayfarm-service"]
    assert services == (["Deployment"] if folder == "standby" else ["StatefulSet"])
    assert {part["metadata"]["namespace"] for part in parts} == {"rayfarm"}


def test_liveness_probe_uses_its_own_port() -> None:
    for part in PARTS:
        if part["metadata"]["name"] == "rayfarm-service" and "template" in part["spec"]:
            (service,) = part["spec"]["template"]["spec"]["containers"]
            ports = {port["name"]: str(port["containerPort"]) for port in service["ports"]}
            told = {one["name"]: one.get("value") for one in service["env"]}
            assert ports[service["livenessProbe"]["httpGet"]["port"]] == told["RAYFARM_HEALTH_PORT"]


def test_pods_satisfy_pod_security_restricted() -> None:
    """All pods satisfy the profile `restricted` of Kubernetes' Pod Security Standards."""
    for part in PARTS:
        if part["kind"] not in ("Deployment", "StatefulSet"):
            continue
        pod = part["spec"]["template"]["spec"]
        assert pod["securityContext"]["runAsNonRoot"] is True
        assert pod["securityContext"]["runAsUser"] > 0
        assert pod["securityContext"]["seccompProfile"] == {"type": "RuntimeDefault"}
        for container in pod["containers"]:
            assert container["securityContext"]["allowPrivilegeEscalation"] is False
            assert container["securityContext"]["capabilities"] == {"drop": ["ALL"]}
            assert container["securityContext"]["readOnlyRootFilesystem"] is True
        allowed = {"emptyDir", "persistentVolumeClaim", "configMap", "secret", "projected", "downwardAPI"}
        assert all(set(volume) - {"name"} <= allowed for volume in pod.get("volumes", []))


def containers() -> dict[str, tuple[dict[str, Any], dict[str, Any]]]:
    """Returns (container, pod) by the container's name, for all containers of all pods."""
    found = {}
    for part in PARTS:
        if part["kind"] in ("Deployment", "StatefulSet"):
            pod = part["spec"]["template"]["spec"]
            found[pod["containers"][0]["name"]] = pod["containers"][0], pod
    return found


@pytest.mark.parametrize(
    ("name", "keys"),
    [("redis", {"redis-password"}), ("worker", {"token"}), ("gpu-worker", {"token"}), ("service", {"token", "redis-password"})],
)
def test_pods_mount_only_needed_secrets(name: str, keys: set[str]) -> None:
    container, pod = containers()[name]
    assert not [each for each in container.get("env", []) if "secretKeyRef" in each.get("valueFrom", {})]
    (secret,) = [each["secret"] for each in pod["volumes"] if "secret" in each]
    assert {item["key"] for item in secret.get("items", [])} in (keys, set())
    text = json.dumps(container)
    assert keys == {key for key in ("token", "redis-password") if f"/secrets/{key}" in text}


def test_every_container_has_probes() -> None:
    for name, (container, _) in containers().items():
        assert {"livenessProbe", "readinessProbe"} <= set(container), name


def test_worker_probes_do_not_need_the_service() -> None:
    container, _ = containers()["worker"]
    live, ready = container["livenessProbe"]["exec"]["command"], container["readinessProbe"]["exec"]["command"]
    assert ready == [*live, "--ready"]
    assert (ROOT / live[-1]).is_file()
    assert live[-1] in (ROOT / "Dockerfile").read_text(), "as the image's own check"


def test_images_are_tagged_by_version() -> None:
    compose = (ROOT / "docker-compose.yml").read_text()
    assert set(re.findall(r"RAYFARM_VERSION:-([^}]+)\}", compose)) == {__version__}
    for folder in ("farm", "gpu", "standby"):
        for image in yaml.safe_load((CLUSTER / folder / "kustomization.yaml").read_text())["images"]:
            assert image["newTag"] == __version__, image["name"]


def test_compose_containers_have_an_init_process() -> None:
    """Compose's containers have an init process, which reaps the processes of a killed health check; only Caddy's has none.

    Without it, these would stay as zombies, which count towards pids_limit. Caddy's container has no health check.
    """
    services = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
    assert {name for name, service in services.items() if "pids_limit" in service and not service.get("init")} <= {"caddy"}
    assert "healthcheck" not in services["caddy"]


@pytest.mark.parametrize(("tls", "internal"), [(None, False), ("public", False), ("internal", True)])
def test_caddy_tls_and_http_versions(tls: str | None, internal: bool) -> None:
    environment = {
        "PATH": os.environ["PATH"],
        "HOME": "/",
        "RAYFARM_DOMAIN": "farm.example",
        **({"RAYFARM_TLS": tls} if tls else {}),
    }
    caddy = Path(sysconfig.get_path("scripts")) / "caddy"
    command = [str(caddy), "adapt", "--config", str(ROOT / "deploy" / "caddy" / "Caddyfile")]
    adapted = json.loads(subprocess.run(command, env=environment, capture_output=True, check=True).stdout)
    (server,) = adapted["apps"]["http"]["servers"].values()
    assert server["protocols"] == ["h1", "h2"]
    policies = adapted["apps"].get("tls", {}).get("automation", {}).get("policies", [])
    assert [policy["issuers"] for policy in policies] == ([[{"module": "internal"}]] if internal else [])


def test_every_selector_matches_a_pod() -> None:
    worn = [part["spec"]["template"]["metadata"]["labels"] for part in PARTS if part["kind"] in ("Deployment", "StatefulSet")]
    for part in PARTS:
        if part["kind"] == "Service":
            assert any(part["spec"]["selector"].items() <= labels.items() for labels in worn), part["metadata"]["name"]


def test_every_variable_of_the_service_is_a_setting() -> None:
    known = {f"RAYFARM_{name.upper()}" for name in Settings.model_fields}
    for service in (part for part in PARTS if part["metadata"]["name"] == "rayfarm-service" and "template" in part["spec"]):
        names = {one["name"] for one in service["spec"]["template"]["spec"]["containers"][0]["env"]}
        assert {name.removesuffix("_FILE") for name in names - {"POD_IP"}} <= known


def test_two_service_overlay_changes_only_what_it_needs() -> None:
    one, two = (part for part in PARTS if part["metadata"]["name"] == "rayfarm-service" and "template" in part["spec"])
    (alone,), (each,) = (part["spec"]["template"]["spec"]["containers"] for part in (one, two))
    assert {key for key in alone if alone[key] != each[key]} == {"env"}
    assert [entry for entry in each["env"] if entry not in alone["env"]] == [
        {"name": "POD_IP", "valueFrom": {"fieldRef": {"fieldPath": "status.podIP"}}},
        {"name": "RAYFARM_PEER_URL", "value": "http://$(POD_IP):8000"},
    ]
    claim = one["spec"]["volumeClaimTemplates"][0]
    shared = one["spec"]["template"]["spec"]["volumes"]
    (volume,) = [each for each in two["spec"]["template"]["spec"]["volumes"] if each not in shared]
    name = f"{claim['metadata']['name']}-{one['metadata']['name']}-0"
    assert volume["persistentVolumeClaim"]["claimName"] == name
    assert claim["spec"] in [part["spec"] for part in PARTS if part["metadata"]["name"] == name]


COMPOSE = yaml.safe_load((ROOT / "docker-compose.yml").read_text())["services"]
OURS = ("secrets", "redis", "service", "standby", "worker", "gpu-worker", "old-worker", "caddy")
EXAMPLE = re.findall(r"^#?(\w+)=", (ROOT / "deploy" / "rayfarm.env.example").read_text(), re.MULTILINE)


@pytest.mark.parametrize("name", OURS)
def test_containers_are_confined(name: str) -> None:
    """Each of our containers has a read-only root, except workers of an old release, which write beside their kernels.

    Each has no capabilities, gains no privileges, and has limits on logs, memory and processes.
    """
    container = COMPOSE[name]
    assert container["read_only"] is (name != "old-worker"), "workers up to 0.2 write beside their kernels"
    assert container["cap_drop"] == ["ALL"]
    assert container["security_opt"] == ["no-new-privileges:true"]
    assert container["logging"]["options"].keys() == {"max-size", "max-file"}
    assert container.get("cap_add", []) == (["NET_BIND_SERVICE"] if name == "caddy" else [])
    if name != "secrets":
        assert {"mem_limit", "pids_limit"} <= container.keys()


def test_only_farm_containers_reach_redis() -> None:
    """Only the farm's containers are on Redis's network and have its secrets."""
    on_queue = {name for name, container in COMPOSE.items() if "queue" in container.get("networks", [])}
    assert on_queue == {"redis", "service", "standby", "worker", "gpu-worker", "old-worker"}
    assert COMPOSE["redis"]["networks"] == ["queue"]
    see = {name for name, one in COMPOSE.items() if any(volume.startswith("secrets:") for volume in one.get("volumes", []))}
    assert see == on_queue | {"secrets"}
    assert yaml.safe_load((ROOT / "docker-compose.yml").read_text())["networks"]["queue"] == {"internal": True}


def test_no_secret_is_in_the_repository() -> None:
    text = (ROOT / "docker-compose.yml").read_text()
    for name in ("RAYFARM_TOKEN", "RAYFARM_REDIS_PASSWORD"):
        assert set(re.findall(rf"\$\{{{name}(:?-?[^}}]*)\}}", text)) == {":-"}


def test_env_file_reaches_every_setting() -> None:
    """Every setting can be set in the file .env: the service's through `env_file`, the others through Compose's substitution."""
    fixed = {"RAYFARM_HOST", "RAYFARM_DATA", "RAYFARM_PUBLISHED", "RAYFARM_PUBLISHED_PORT", "RAYFARM_WEB", "RAYFARM_EXAMPLES"}
    settings = {f"RAYFARM_{name.upper()}" for name in Settings.model_fields} - fixed
    text = (ROOT / "docker-compose.yml").read_text()
    substituted = set(re.findall(r"(?<!\$)\$\{(\w+)", text)) - {"RAYFARM_ENV_FILE"}
    of_programs = {"RAYFARM_TLS_CERT", "RAYFARM_API_TOKEN", "RAYFARM_CACHE", "RAYFARM_KERNELS", "RAYFARM_ALIVE", *fixed}
    of_programs.add("RAYFARM_DENOISER")  # the images lack the library that it chooses
    table = (ROOT / "docs" / "settings.md").read_text().partition("## Settings")[2].partition("\n## ")[0]
    rows = [line.split("|")[1] for line in table.splitlines() if line.startswith("| `")]
    documented = {name for row in rows for name in re.findall(r"`(RAYFARM_\w+)`", row)} - of_programs
    assert len(EXAMPLE) == len(set(EXAMPLE))
    assert (settings | substituted | documented) - set(EXAMPLE) == set()
    assert {name for name in EXAMPLE if name.startswith("RAYFARM_")} - settings - substituted - documented == {"RAYFARM_ENV_FILE"}


def test_env_file_defaults_change_nothing() -> None:
    set_ = [line for line in (ROOT / "deploy" / "rayfarm.env.example").read_text().splitlines() if line and line[0] != "#"]
    assert set_ == ["RAYFARM_ENV_FILE=.env"]
    assert COMPOSE["service"]["env_file"] == "${RAYFARM_ENV_FILE:-deploy/rayfarm.env.example}"


def test_compose_file_suits_the_first_release() -> None:
    """docker-compose.yml uses no nested defaults, which Compose's first release does not support."""
    assert not re.search(r"\$\{[^}]*\$\{", (ROOT / "docker-compose.yml").read_text())


@pytest.mark.parametrize("name", ("worker", "gpu-worker"))
def test_cluster_worker_options_exist(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    arguments = containers()[name][0]["args"]
    assert arguments[:3] == ["python3", "-m", "worker"]
    monkeypatch.setattr("sys.argv", arguments[2:])
    options = _options()
    assert options.service == "http://rayfarm:8000"
    assert (options.gpu, options.paired) == (("only", True) if name == "gpu-worker" else ("auto", False))


def test_gpu_workers_request_gpus() -> None:
    cluster, _ = containers()["gpu-worker"]
    assert cluster["resources"]["limits"]["nvidia.com/gpu"] == 1
    compose = COMPOSE["gpu-worker"]
    (devices,) = compose["deploy"]["resources"]["reservations"]["devices"]
    assert devices == {"driver": "nvidia", "count": "all", "capabilities": ["gpu"]}
    assert compose["profiles"] == ["gpu"]
    assert compose["command"][-3:] == ["--gpu", "only", "--paired"]
    assert compose["environment"].items() > COMPOSE["worker"]["environment"].items()


@pytest.mark.parametrize(("given", "gpu"), (({}, "none"), ({"SLURM_GPUS_ON_NODE": "1"}, "auto")))
def test_slurm_task_uses_its_gpus(given: dict[str, str], gpu: str, tmp_path: Path) -> None:
    program = tmp_path / "rayfarm"
    program.write_text('#!/bin/sh\necho "$@"\n')
    program.chmod(0o755)
    environment = {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "USER": "ann",
        "RAYFARM_TOKEN": "t",
        "RAYFARM_SERVICE": "http://farm",
    }
    script = ROOT / "deploy" / "slurm" / "rayfarm-workers.sbatch"
    done = subprocess.run(
        ["bash", str(script)],
        env={**environment, "SLURM_CPUS_PER_TASK": "3", **given},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    assert done.stdout.split() == ["worker", "--join", "http://farm", "--slots", "3", "--gpu", gpu]


def test_autoscaling_uses_a_published_metric() -> None:
    scaling = yaml.safe_load((CLUSTER / "autoscale" / "worker-scaling.yaml").read_text())
    (trigger,) = scaling["spec"]["triggers"]
    shown = yaml.safe_load((CLUSTER / "autoscale" / "token.yaml").read_text())
    assert trigger["authenticationRef"]["name"] == shown["metadata"]["name"]
    told = re.findall(r'"(rayfarm_\w+)"', (ROOT / "service" / "routes" / "metrics.py").read_text())
    assert trigger["metadata"]["valueLocation"] in told
    assert scaling["spec"]["scaleTargetRef"]["name"] in [part["metadata"]["name"] for part in PARTS]
