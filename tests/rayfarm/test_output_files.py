"""Tests of writing pictures to disk.

An older file is replaced, links and permissions are kept, and the path is checked before rendering.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from rayfarm.cli import main
from rayfarm.errors import CommandError
from rayfarm.output_files import check_writable, write
from tests.helpers import ROOT


def test_overwriting_keeps_links_and_permissions(tmp_path: Path) -> None:
    real = tmp_path / "real.png"
    real.write_bytes(b"older")
    real.chmod(0o640)
    link = tmp_path / "link.png"
    link.symlink_to(real)
    check_writable(link)
    assert real.read_bytes() == b"older", "to look changes nothing"
    write(link, b"newer")
    assert link.is_symlink()
    assert real.read_bytes() == b"newer"
    assert real.stat().st_mode & 0o777 == 0o640
    new = tmp_path / "new.png"
    check_writable(new)
    assert not new.exists()
    before = os.umask(0o022)
    try:
        write(new, b"new")
    finally:
        os.umask(before)
    assert new.stat().st_mode & 0o777 == 0o644
    assert sorted(path.name for path in tmp_path.iterdir()) == ["link.png", "new.png", "real.png"]


def test_writable_file_in_read_only_folder_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def denied(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    output = tmp_path / "out.png"
    output.write_bytes(b"older")
    monkeypatch.setattr("rayfarm.output_files.tempfile.mkstemp", denied)
    monkeypatch.setattr("rayfarm.output_files.tempfile.NamedTemporaryFile", denied)
    check_writable(output)
    write(output, b"newer")
    assert output.read_bytes() == b"newer"
    with pytest.raises(CommandError, match=r"Permission denied\). Name another file"):
        check_writable(tmp_path / "new.png")


@pytest.mark.parametrize(
    "wrong", [["-o", "{}/missing/out.png"], ["-o", "{}"], ["-o", "{}/out.png", "--stats", "{}/missing/stats.json"]]
)
def test_render_checks_output_path_first(
    wrong: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [part.format(tmp_path) for part in wrong]
    monkeypatch.setattr("sys.argv", ["rayfarm", "render", str(ROOT / "scenes" / "cornell-box.yaml"), *arguments])
    monkeypatch.setattr("rayfarm.commands.render.load_scene", lambda *_: pytest.fail("it begins to work"))
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    said = capsys.readouterr().err
    assert "There is no folder" in said or "is a folder" in said
