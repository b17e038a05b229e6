"""What comes for clusters and clouds: held against the schemas of Kubernetes, and against what the sources say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import kubernetes_validate
import pytest
import yaml

from service.settings import Settings
from worker.__main__ import _options

ROOT = Path(__file__).parents[1]
CLUSTER = ROOT / "deploy" / "kubernetes"
PARTS = [part for file in ("redis", "service", "worker") for part in yaml.safe_load_all((CLUSTER / f"{file}.yaml").read_text())]


@pytest.mark.parametrize("part", PARTS, ids=lambda part: f"{part['kind']}-{part['metadata']['name']}")
@pytest.mark.parametrize("release", ["1.29", "1.34"])
def test_kubernetes_understands_every_part(part: dict[str, Any], release: str) -> None:
    kubernetes_validate.validate(part, release, strict=True)


def test_every_label_that_is_selected_by_is_worn() -> None:
    worn = [part["spec"]["template"]["metadata"]["labels"] for part in PARTS if part["kind"] in ("Deployment", "StatefulSet")]
    for part in PARTS:
        if part["kind"] == "Service":
            assert any(part["spec"]["selector"].items() <= labels.items() for labels in worn), part["metadata"]["name"]


def test_every_variable_of_the_service_is_a_setting() -> None:
    (service,) = [part for part in PARTS if part["kind"] == "StatefulSet"]
    names = {one["name"] for one in service["spec"]["template"]["spec"]["containers"][0]["env"]}
    assert names <= {f"RAYFARM_{name.upper()}" for name in Settings.model_fields}


def test_the_worker_of_the_cluster_is_started_with_options_that_there_are(monkeypatch: pytest.MonkeyPatch) -> None:
    (worker,) = [part for part in PARTS if part["metadata"]["name"] == "rayfarm-worker"]
    arguments = worker["spec"]["template"]["spec"]["containers"][0]["args"]
    assert arguments[:3] == ["python3", "-m", "worker"]
    monkeypatch.setattr("sys.argv", arguments[2:])
    assert _options().service == "http://rayfarm:8000"


def test_the_cluster_scales_by_a_number_that_is_told() -> None:
    scaling = yaml.safe_load((CLUSTER / "autoscale" / "worker-scaling.yaml").read_text())
    (trigger,) = scaling["spec"]["triggers"]
    shown = yaml.safe_load((CLUSTER / "autoscale" / "token.yaml").read_text())
    assert trigger["authenticationRef"]["name"] == shown["metadata"]["name"]
    told = re.findall(r'"(rayfarm_\w+)"', (ROOT / "service" / "api" / "metrics.py").read_text())
    assert trigger["metadata"]["valueLocation"] in told
    assert scaling["spec"]["scaleTargetRef"]["name"] in [part["metadata"]["name"] for part in PARTS]
