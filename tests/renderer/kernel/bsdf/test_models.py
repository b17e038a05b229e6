"""Tests that BSDF models are complete, by the list in docs/architecture.md, "To add X, touch Y"."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import renderer.kernel.bsdf
from renderer.arrays import rows
from tests.renderer.kernel.bsdf.test_bsdf import MODELS

# Delta lobes have no density, and unlit materials do not scatter.
DELTA = ("sample_mirror", "sample_glass", "sample_smooth_conductor")
JUDGED_ELSEWHERE = {"hair", "interface", "mirror", "unlit"}


def test_every_sampled_lobe_has_eval_and_pdf():
    folder = Path(renderer.kernel.bsdf.__file__).parent
    lobes = 0
    for path in folder.glob("*.py"):
        module = import_module(f"renderer.kernel.bsdf.{path.stem}")
        public = set(getattr(module, "__all__", ()))
        for name in public:
            if not name.startswith("sample_") or name in DELTA or name.startswith("sample_visible_"):
                continue  # these sample microfacet normals, from which lobes are built
            lobe = name.removeprefix("sample_")
            assert public >= {f"eval_and_pdf_{lobe}"} or public >= {f"eval_{lobe}", f"pdf_{lobe}"}, f"{path.name}: {name}"
            lobes += 1
    assert lobes >= 8


def test_every_scattering_kind_has_a_chi_squared_test():
    assert {m.kind for m in MODELS.values()} | JUDGED_ELSEWHERE >= {kind.name for kind in rows.KINDS if kind.in_files}
