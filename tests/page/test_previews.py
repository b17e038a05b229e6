"""Tests of when the page asks for a denoised preview of a film that is being rendered."""

from __future__ import annotations

from tests.page.node import Node

DUE = """
    const { Film } = await read("/js/film/film.js");
    globalThis.document.hidden = a.hidden ?? false;
    const film = new Film(4, 2);
    for (const [x, spp] of a.tiles) film.put({ x, y: 0, w: 2, h: 2, spp, words: new Uint32Array(4) });
    const look = a.look && { total: a.look };
    const state = { value: { channel: "denoised", waiting: false, error: null } };
    const live = { film, look, side: 2, isRendering: a.rendering ?? true };
    return m.PictureSide.prototype.isPreviewDue.call({ live, state, previewAt: 0, madeOf: a.made ?? Infinity });"""


def test_preview_is_of_whole_film_and_better_than_what_is_shown(node: Node) -> None:
    def is_due(**given: object) -> object:
        return node.call("film/picture-side", DUE, given)

    assert is_due(tiles=[[0, 1]]) is False, "half of it is black"
    assert is_due(tiles=[[0, 1], [2, 1]]) is True
    assert is_due(tiles=[[0, 1], [2, 1]], hidden=True) is False, "the page is hidden"
    assert is_due(tiles=[[0, 1], [2, 1]], rendering=False) is False
    assert is_due(tiles=[[0, 1], [2, 1]], look=32) is False, "the live view's picture has more samples"
    assert is_due(tiles=[[0, 4], [2, 4]], look=32) is True
    assert is_due(tiles=[[0, 8], [2, 8]], look=9999) is True, "the job's picture is to be seen at last"
    assert is_due(tiles=[[0, 4], [2, 4]], made=17) is False
    assert is_due(tiles=[[0, 4], [2, 4]], made=16) is True
