"""Tests that each sampled lobe of a BSDF model has a function of its value and density."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path

import renderer.kernel.bsdf

# Delta lobes have no density.
DELTA = ("sample_mirror", "sample_glass", "sample_smooth_conductor")


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
