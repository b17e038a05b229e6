"""What a second process compiles is what the first one asks for."""

from __future__ import annotations

import pytest

from renderer import beside, jit
from renderer.machine_code import noted
from renderer.render import PLAIN, kernel_name, warm_up


def test_what_is_compiled_beside_is_a_part_of_the_kernel(monkeypatch: pytest.MonkeyPatch) -> None:
    warm_up(edition=PLAIN)
    folder = jit.cache_folder()
    for kept in folder.rglob("*_half_of_render_pool*"):
        kept.unlink()  # so that it is compiled here, of what is in memory, or is read now, of the kernel
    monkeypatch.setattr(beside, "prepare", lambda: None)
    with noted() as files:
        beside.main([PLAIN])
    names = {path.relative_to(folder).as_posix() for path in files if "_half_of_render_pool" not in path.name}
    assert names <= set((folder / f"{kernel_name(edition=PLAIN)}.done").read_text().split())


def test_no_edition_is_what_prepares_scenes_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(beside, "prepare", lambda: done.append("prepared"))
    beside.main([])
    assert done == ["prepared"]
