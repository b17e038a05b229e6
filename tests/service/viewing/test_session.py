"""Tests of the drafts and denoised pictures of a view's session."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from protocol.pictures import DRAFT, VIEW, decode_view
from renderer.film import SAMPLES, plane_count
from renderer.image import rgbe9995
from renderer.settings import RenderSettings, View
from service.viewing import denoised
from service.viewing import session as view_session
from service.viewing.denoised import DENOISING_FAILURES_ALLOWED
from service.viewing.passes import FIRST_GUIDES, GUIDES_AFTER, DraftSize, Piece
from service.viewing.session import ViewSession

SETTINGS = RenderSettings(96, 64, View((0.0, 0.0, 4.0), (0.0, 0.0, 0.0)))
WHOLE = DraftSize(96, 64, 4)
CPU_S = 1e-6
SLOW_S = 1e-3  # with which a sample of the whole view takes six seconds


def show(
    session: ViewSession,
    id: int,
    draft: DraftSize | None = WHOLE,
    denoises: bool = False,
    cost_s: float = CPU_S,
    slots: int = 1,
    **settings: Any,
) -> None:
    """Begins to render view `id`. cost_s: seconds per sample of a pixel. slots: of the farm."""
    own = replace(SETTINGS, **settings)
    about = {"samples": 32, "noise": None, "has_alpha": True, "draft_exposure": 0.0, "is_home": True, "upload": "a scene"}
    request: Any = SimpleNamespace(id=id, settings=own, frame_request=None, **about)
    session.switch_to(request, id)
    session.begin_rendering(own, "c", "k", cost_s, slots, denoises, draft=draft)


def drafted(session: ViewSession) -> ViewSession:
    session.put_draft(b"JPEG")
    return session


@pytest.fixture
def session() -> ViewSession:
    return ViewSession(lambda: None)


def add_samples(session: ViewSession, first: int, count: int, *, is_guide: bool = False) -> None:
    """Adds samples of all tiles; is_guide: their first hits alone."""
    assert session.passes is not None
    for number, tile in enumerate(session.passes.levels[-1].tiles):
        sums = np.zeros((plane_count(0), tile.h, tile.w), np.int64)
        sums[SAMPLES] = count
        session.add(Piece(len(session.passes.levels) - 1, number, first, count, is_guide), sums)


def test_draft_is_sent_once_and_a_newer_one_replaces_it(session: ViewSession) -> None:
    show(session, 1)
    assert session.take_draft(4) is None and not session.has_picture
    drafted(session)
    assert session.has_picture
    show(session, 2)
    packet = session.take_draft(5)
    assert packet is not None
    assert DRAFT.unpack(packet)[:2] == (1, 5), "the draft of the previous view, which was not sent yet"
    drafted(session)
    show(session, 3)
    packet = drafted(session).take_draft(6)
    assert packet is not None
    assert (DRAFT.unpack(packet).id, packet[DRAFT.size :]) == (3, b"JPEG")
    assert session.take_draft(7) is None


def test_pieces_wait_until_the_view_rests(session: ViewSession, monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(view_session.time, "monotonic", lambda: now[0])
    show(session, 1)
    assert session.piece_wait_s == np.inf
    drafted(session)
    assert 0 < session.piece_wait_s <= view_session.DRAFT_REST_S + 1e-9
    now[0] += view_session.DRAFT_REST_S + 1e-9
    assert session.piece_wait_s <= 0


def test_later_pictures_have_no_fewer_samples_than_the_draft(session: ViewSession) -> None:
    show(session, 1)
    drafted(session).take_draft(1)
    assert (session.samples, session.mean_samples) == (4, 4)
    assert session.passes is not None and len(session.passes.levels) == 1, "without a small picture"
    for first, count in ((0, 1), (1, 1), (2, 1)):
        add_samples(session, first, count)
        assert session.take_packet(2) is None
    add_samples(session, 3, 1)
    packet = session.take_packet(2)
    assert packet is not None
    assert (VIEW.unpack(packet).id, VIEW.unpack(packet).tiles) == (1, len(session.passes.levels[0].tiles))


def test_first_picture_follows_a_draft_of_reduced_size_at_once(session: ViewSession) -> None:
    show(session, 1, DraftSize(48, 32, 1))
    drafted(session).take_draft(1)
    assert session.samples == 0
    add_samples(session, 0, 1)
    assert session.take_packet(2) is not None


def test_transparent_view_has_no_draft(session: ViewSession) -> None:
    show(session, 1, background="transparent")
    assert session.draft_size is None and session.piece_wait_s <= 0


def test_denoised_view_has_a_draft_and_no_noise_after_it(session: ViewSession) -> None:
    """The draft stays until a picture with as many samples is denoised; while it has not come, the next view waits."""
    show(session, 1, denoises=True)
    session.wanted = session.request
    assert not session.is_ready_for_next
    drafted(session).take_draft(1)
    assert session.is_ready_for_next, "although nothing is denoised"
    for first in range(3):
        add_samples(session, first, 1)
        assert session.begin_denoising() is None and session.take_packet(2) is None
    add_samples(session, 3, 1)
    assert session.begin_denoising() is None, "its guides come first"
    add_samples(session, GUIDES_AFTER, FIRST_GUIDES - GUIDES_AFTER, is_guide=True)
    assert session.begin_denoising() == (96, 64, True) and session.take_packet(2) is None
    session.end_denoising(bytes(4 * 96 * 64))
    packet = session.take_packet(2)
    assert packet is not None and VIEW.unpack(packet).tiles == 1 and session.is_denoised


def test_view_shows_its_noise_only_after_several_pictures_could_not_be_denoised(
    session: ViewSession, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One failure may be due to a busy machine: the next picture is tried, and noise does not replace what is shown."""
    monkeypatch.setattr(denoised, "LOST_S", 0.0)
    show(session, 1, denoises=True)
    drafted(session).take_draft(1)
    for first in range(4):
        add_samples(session, first, 1)
    add_samples(session, GUIDES_AFTER, FIRST_GUIDES - GUIDES_AFTER, is_guide=True)
    for _ in range(DENOISING_FAILURES_ALLOWED):
        assert session.denoises and session.take_packet(2) is None
        assert session.begin_denoising() is not None
        session.fail_denoising()
    assert not session.denoises and session.take_packet(2) is not None


@pytest.mark.parametrize(("cost_s", "first"), [(CPU_S, 4), (SLOW_S, 2)])
def test_few_samples_are_denoised_only_where_more_take_long(session: ViewSession, cost_s: float, first: int) -> None:
    """On a fast farm, denoising fewer samples would save no time. Clean guides are awaited on any."""
    show(session, 1, None, denoises=True, cost_s=cost_s)
    for number in range(first):
        add_samples(session, number, 1)
        assert session.begin_denoising() is None
    add_samples(session, GUIDES_AFTER, FIRST_GUIDES - GUIDES_AFTER, is_guide=True)
    assert session.begin_denoising() == (96, 64, True)


def test_few_slots_leave_their_cores_to_the_first_denoising(session: ViewSession) -> None:
    def guided(number: int) -> None:
        add_samples(session, number, 2)
        if number == 0:
            add_samples(session, GUIDES_AFTER, FIRST_GUIDES - GUIDES_AFTER, is_guide=True)

    show(session, 1, None, denoises=True, cost_s=SLOW_S)
    guided(0)
    assert not session.spares_slots, "it has not begun"
    assert session.begin_denoising() and session.spares_slots
    session.end_denoising(bytes(4 * 96 * 64))
    session._denoised._rests_until = 0.0  # type: ignore[union-attr]
    guided(2)
    assert session.begin_denoising() and not session.spares_slots, "later ones go on beside the samples"
    show(session, 2, None, denoises=True, cost_s=SLOW_S, slots=16)
    guided(0)
    assert session.begin_denoising() and not session.spares_slots, "others have cores to spare"


def test_denoised_picture_is_exact_before_the_view_is_complete(session: ViewSession) -> None:
    """The steps of coarse brightness, 2 %, are blotches where noise does not hide them."""
    show(session, 1, None, denoises=True, cost_s=SLOW_S)
    add_samples(session, 0, 2)
    add_samples(session, GUIDES_AFTER, FIRST_GUIDES - GUIDES_AFTER, is_guide=True)
    width, height, _ = session.begin_denoising() or (0, 0, False)
    gradient = np.full((height, width, 3), np.linspace(0.46, 0.5, width, dtype=np.float32)[:, None], np.float32)
    session.end_denoising(rgbe9995.pack(gradient).astype("<u4").tobytes())
    packet = session.take_packet(1)
    assert packet is not None
    (tile,) = decode_view(packet).tiles
    np.testing.assert_allclose(tile.mean, np.moveaxis(gradient, -1, 0), rtol=2.0**-9)


def test_view_whose_draft_is_lost_is_rendered_without(session: ViewSession) -> None:
    show(session, 1)
    session.stop_drafts()
    assert session.settings is None, "the scheduler begins the view again"
    session.begin_rendering(SETTINGS, "c", "k", CPU_S, 1, draft=WHOLE)
    assert session.draft_size is None
    show(session, 2)
    assert session.draft_size is not None


def test_settled_picture_is_the_latest_denoised_one_and_stays_after_it_was_shown(session: ViewSession) -> None:
    show(session, 1, denoises=True)
    add_samples(session, 0, 16)
    assert session.settled_picture(1, 1) is None, "it is not denoised yet"
    assert session.begin_denoising() == (96, 64, True)
    session.end_denoising(rgbe9995.pack(np.full((64, 96, 3), 0.25, np.float32)).astype("<u4").tobytes())
    session.take_packet(1)
    found = session.settled_picture(100, 16)
    assert found is not None and (found.scene, found.samples, found.is_denoised) == ("a scene", 16.0, True)
    assert found.color.shape == (64, 96, 3) and np.allclose(found.color, 0.25)
    assert session.settled_picture(1, 17) is None


@pytest.mark.parametrize("is_lost", [False, True])
@pytest.mark.parametrize("min_samples", [4, 8])
def test_view_that_is_left_while_it_is_denoised_is_denoised_again_only_if_needed(
    session: ViewSession, min_samples: int, is_lost: bool
) -> None:
    """Denoising it twice would delay the job that was started from the view."""
    show(session, 1, denoises=True)
    add_samples(session, 0, 6)
    add_samples(session, GUIDES_AFTER, FIRST_GUIDES - GUIDES_AFTER, is_guide=True)
    assert session.begin_denoising() is not None
    add_samples(session, 6, 6)
    session.end_sampling(min_samples)
    session.fail_denoising() if is_lost else session.end_denoising(bytes(4 * 96 * 64))
    assert session.awaits_denoising(min_samples) is (is_lost or min_samples == 8)
    session._denoised._lost_until = 0.0  # type: ignore[union-attr]
    assert (session.begin_denoising() is not None) is (is_lost or min_samples == 8)


def test_settled_picture_of_view_without_denoiser_has_enough_samples(session: ViewSession) -> None:
    show(session, 1)
    add_samples(session, 0, 8)
    assert session.settled_picture(16, 1) is None
    add_samples(session, 8, 8)
    found = session.settled_picture(16, 1)
    assert found is not None and (found.samples, found.is_denoised) == (16.0, False)
    show(session, 2, background="transparent")
    assert session.settled_picture(0, 0) is None, "JPEG has no alpha"
    show(session, 3)
    add_samples(session, 0, 16)
    assert session.settled_picture(16, 1) is not None and session.request is not None
    session.request.is_home = False
    assert session.settled_picture(16, 1) is None, "it is of another view"
