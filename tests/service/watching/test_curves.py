"""Tests of the service's tone curves and OpenColorIO views: names, settings, and the packet of a view's table."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from protocol.view_table import VIEW_TABLE, encode_view_table
from renderer.image import ocio
from service.errors import Invalid, StartupError
from service.watching import curves
from service.watching.curves import Curves


def test_names_are_built_in_curves_or_views() -> None:
    known = Curves("")
    assert known.find("agx") == "agx"
    assert known.find("ocio") is not known.find("agx")
    assert [view.display for view in known.views][:2] == ["sRGB - Display"] * 2
    assert known.find(known.views[1].name) is known.find(known.views[1].name)
    with pytest.raises(Invalid, match=r"'agxx' is not a tone curve; the curves are neutral, .*, ocio:VIEW"):
        known.find("agxx")
    with pytest.raises(Invalid, match="'ocio:agx' is no view of the OCIO config 'cg'"):
        known.find("ocio:agx")


def test_off_has_no_views() -> None:
    known = Curves("off")
    assert known.views == ()
    with pytest.raises(Invalid, match="RAYFARM_OCIO"):
        known.find("ocio")


def test_service_without_the_package_has_built_in_curves_only(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in (ocio, curves):
        monkeypatch.setattr(module, "is_installed", lambda: False)
    assert Curves("").views == ()


def test_config_that_cannot_be_opened_ends_the_start(tmp_path: Path) -> None:
    with pytest.raises(StartupError, match=r"RAYFARM_OCIO: the OCIO config .* cannot be read"):
        Curves(str(tmp_path / "none.ocio"))


def test_table_packet_has_its_size_and_words() -> None:
    words = np.arange(8, dtype=np.uint32).reshape(2, 2, 2)
    packet = encode_view_table(words)
    assert VIEW_TABLE.unpack(packet).size == 2
    assert struct.unpack_from("<8I", packet, VIEW_TABLE.size) == tuple(range(8))
