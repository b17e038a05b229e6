"""Tests of when the page asks for a denoised preview of a film that is being rendered, and of how often it draws the film."""

from __future__ import annotations

import pytest

from tests.page.node import Node

DUE = """
    const { Film } = await read("/js/film/film.js");
    globalThis.document.hidden = a.hidden ?? false;
    const film = new Film(4, 2);
    for (const [x, spp] of a.tiles) film.put({ x, y: 0, w: 2, h: 2, spp, words: new Uint32Array(4) });
    const look = a.look && { total: a.look };
    const state = { value: { channel: "denoised", waiting: false, error: a.failed ? new Error("503") : null } };
    const previewAt = performance.now() + (a.failed ?? 0);
    const live = { film, look, clean: a.clean, worth: a.worth, isAgain: a.again, side: 2, isRendering: a.rendering ?? true };
    const coveredAt = a.waited && performance.now() - a.waited;
    const side = { live, state, coveredAt, previewAt, previewFrom: a.from ?? Infinity, madeOf: a.made ?? Infinity };
    return Object.assign(Object.create(m.PictureSide.prototype), side)[a.noise ? "isNoiseDue" : "isPreviewDue"]();"""


def test_preview_is_of_whole_film_and_better_than_what_is_shown(node: Node) -> None:
    def is_due(**given: object) -> object:
        return node.call("film/picture-side", DUE, given)

    assert is_due(tiles=[[0, 1]]) is False, "half of it is black"
    assert is_due(tiles=[[0, 1], [2, 1]]) is True
    assert is_due(tiles=[[0, 1], [2, 1]], hidden=True) is False, "the page is hidden"
    assert is_due(tiles=[[0, 1], [2, 1]], rendering=False) is False
    for start in ({"look": 32}, {"clean": "data:,"}):
        assert is_due(tiles=[[0, 1], [2, 1]], worth=0, **start) is True, "the start is of another light"
        assert is_due(tiles=[[0, 3], [2, 9]], worth=4, **start) is False, "the start is sharper"
        assert is_due(tiles=[[0, 1], [2, 9]], worth=4, waited=3000, **start) is False, "its edges would be ragged"
        assert is_due(tiles=[[0, 4], [2, 9]], worth=4, waited=3000, **start) is True
        assert is_due(tiles=[[0, 15], [2, 40]], worth=16, **start) is False, "a clear start does not go at once"
        assert is_due(tiles=[[0, 16], [2, 16]], worth=16, **start) is True
        for worth in (16, 64):
            assert is_due(tiles=[[0, 4], [2, 4]], worth=worth, waited=3000, **start) is True, (
                "the job's own picture is to be seen"
            )
            assert is_due(tiles=[[0, 3], [2, 4]], worth=worth, waited=3000, **start) is False, "few samples smear"
            assert is_due(tiles=[[0, 1], [2, 1]], worth=worth, waited=9000, **start) is True, "a slow scene"
    assert is_due(tiles=[[0, 8], [2, 8]], look=9999, again=True) is False, "an earlier picture is better"
    assert is_due(tiles=[[0, 8], [2, 8]], look=64, again=True) is True
    for spp, made, due in ((4, 26, False), (4, 25, True), (127, 512, False), (128, 512, True)):
        assert is_due(tiles=[[0, spp], [2, spp]], made=made) is due, "growth by a quarter below 64 samples per pixel, else by two"


def test_film_is_shown_with_its_noise_if_no_denoised_picture_comes(node: Node) -> None:
    def is_due(waited: int, **given: object) -> object:
        return node.call("film/picture-side", DUE, {"noise": True, "tiles": [[0, 1], [2, 1]], "waited": waited, **given})

    assert is_due(1500, clean="data:,", worth=0) is False, "a denoised one may come"
    assert is_due(2500, clean="data:,", worth=0) is True, "what is shown is of another light or camera"
    assert is_due(2500, clean="data:,", worth=0, tiles=[[0, 1]]) is False, "half of it is black"
    assert is_due(2500, clean="data:,", worth=4) is False, "noise is worse than the preview mesh"
    assert is_due(6000, clean="data:,", worth=4) is True
    assert is_due(6000, clean="data:,", worth=16) is False, "a clear picture of the same view is better"
    assert is_due(13_000, clean="data:,", worth=16) is True, "after 12 s the picture is shown as it grows"
    assert is_due(13_000, look=64, worth=16, again=True) is False
    assert is_due(2500) is False, "the poster is of the same picture"
    assert is_due(6000) is True


def test_failed_preview_is_asked_for_again(node: Node) -> None:
    """Otherwise the picture of few samples would stay until the job has ended."""
    enough = {"tiles": [[0, 4], [2, 4]], "made": 8}
    assert node.call("film/picture-side", DUE, {**enough, "failed": 5000}) is False
    assert node.call("film/picture-side", DUE, {**enough, "failed": -1}) is True


def test_unchanged_preview_is_asked_for_again_once_its_samples_have_quadrupled(node: Node) -> None:
    rests = {"tiles": [[0, 4], [2, 4]], "made": 8, "failed": 3000}
    assert node.call("film/picture-side", DUE, {**rests, "from": 33}) is False
    assert node.call("film/picture-side", DUE, {**rests, "from": 32}) is True


FINISHING = """
    const { Film } = await read("/js/film/film.js");
    const film = new Film(4, 2);
    film.put({ x: 0, y: 0, w: 4, h: 2, spp: 64, words: new Uint32Array(8) });
    const state = { value: { channel: "denoised", error: a.failed ? new Error("503") : null } };
    const live = { film, isRendering: a.rendering ?? false, finished: !a.rendering, isDenoisedStored: a.stored ?? false };
    const shown = { fetched: a.spp ? {} : null, madeOf: a.spp ? 8 * a.spp : Infinity, isPreview: a.preview ?? true };
    const side = Object.assign(Object.create(m.PictureSide.prototype), { live, state, ...shown });
    return [side.previewSpp(), side.awaitsLast()];"""


def test_finished_job_says_that_its_denoised_picture_is_to_come(node: Node) -> None:
    def said(**given: object) -> object:
        return node.call("film/picture-side", FINISHING, given)

    assert said(spp=29, rendering=True) == [29, True], "the job's state may be known before its last samples are here"
    assert said(spp=29) == [29, True]
    assert said(spp=29, failed=True) == [29, False], "nothing better comes"
    assert said(spp=64) == [None, True], "a preview of all samples is not the last picture"
    assert said(spp=64, preview=False) == [None, False]
    assert said() == [None, True], "none has been shown yet"
    assert said(stored=True) == [None, False], "it comes at once"


ENDS = """
    const film = { total: 64, width: 1, height: 1 };
    const value = { channel: "denoised", waiting: a.waiting ?? false, isFinal: a.final ?? false, error: null };
    const state = { value, update: (change) => (state.value = change(state.value)) };
    const live = { film, isRendering: a.rendering ?? false, finished: !a.rendering };
    const own = { live, state, isPreview: true, fetched: a.empty ? null : {}, madeOf: 60, layer: {}, toldSpp: 0 };
    const side = Object.assign(Object.create(m.PictureSide.prototype), own, { fetching: new AbortController() });
    const asked = [];
    side.fetch = () => asked.push(side.live.isRendering ? "preview" : "picture");
    side.isPreviewDue = () => side.live.isRendering && !state.value.waiting;
    side.lookAgain();
    return [asked, side.fetching.signal.aborted];"""


def test_last_picture_is_requested_at_the_end_of_a_job(node: Node) -> None:
    def asked(**given: object) -> object:
        return node.call("film/picture-side", ENDS, given)

    assert asked() == [["picture"], False]
    assert asked(waiting=True) == [["picture"], False], "the preview that is being made is of no use any more"
    assert asked(waiting=True, final=True) == [[], False], "it is on its way"
    assert asked(waiting=True, empty=True) == [[], False], "nothing is shown yet: the preview comes first"
    assert asked(waiting=True, rendering=True) == [[], False]
    assert asked(waiting=True, final=True, rendering=True) == [["preview"], True], "it was paused, and renders again"


STEPS = """
    const finishing = new m.Finishing();
    return a.map(([at, is]) => {
        finishing.update(is, 4, at);
        return [finishing.left(at), finishing.progress(at)].map((n) => n && Number(n.toFixed(2)));
    });"""


def test_progress_of_the_last_picture_grows_until_it_is_there(node: Node) -> None:
    steps = [[0, False], [1, True], [3, True], [5, True], [9, True], [100, True], [101, False], [102, True]]
    shown = node.call("job/finishing", STEPS, steps)
    assert [left for left, _ in shown] == [None, 4, 2, 1, 1, 1, None, 4]
    assert [part for _, part in shown] == [0, 0, 0.45, 0.9, 0.95, 1.0, 0, 0]


def test_progress_of_a_job_includes_its_last_picture_and_does_not_go_back(node: Node) -> None:
    # (progress of the samples, seconds rendered, progress of the last picture); the first sample took 3 s to come
    reports = [[0, 2, 0], [0.02, 3, 0], [0.1, 4, 0], [0.6, 9, 0], [0.99, 14, 0], [1, 14, 0], [1, 14, 0.5], [1, 14, 1]]
    shown = node.call(
        "job/finishing", "return a.map(([rendered, active, last]) => m.wholeProgress(rendered, active, 6, last));", reports
    )
    assert shown == sorted(shown)
    assert shown[5:] == pytest.approx([0.7, 0.85, 1])
    assert node.call("job/finishing", "return m.wholeProgress(0.25, 10, 0, 0);") == 0.25, "nothing is denoised"


def test_elapsed_time_counts_the_last_picture(node: Node) -> None:
    """It runs on while the job is finishing, and then is the service's; the picture comes before its description."""
    body = """
        const elapsed = new m.Elapsed();
        return a.map(([at, isFinishing, job]) => {
            if (job) elapsed.update({ state: job[0], active_s: job[1], elapsed_s: job[2] }, at);
            return elapsed.seconds(isFinishing, at);
        });"""
    steps: list[list[object]] = [
        [0, False, ["running", 12, 12]],
        [1, False, None],
        [1.5, True, ["finished", 13, 13]],
        [5.5, True, None],
        [8.5, True, None],
        [9, False, None],  # the picture is there
        [9.1, False, ["finished", 13, 19.8]],
        [60, False, None],
        [61, False, ["running", 13, 13]],  # more samples
        [63, False, None],
        [64, False, ["paused", 15, 15]],
    ]
    assert node.call("job/elapsed", body, steps) == [12, 13, 13, 17, 20, 20, 19.8, 19.8, 13, 15, 15]


def test_job_that_ended_earlier_is_not_finishing(node: Node) -> None:
    cases = [["finished", 1000, 1030], ["finished", 1000, 1100], ["running", None, 1100], ["paused", 1000, 1100]]
    body = "return a.map(([state, finished, now]) => m.endedBefore({ state, finished }, now));"
    assert node.call("job/finishing", body, cases) == [False, True, False, False]


FAILS = """
    const real = globalThis.fetch;
    globalThis.fetch = async () => new Response("{}", { status: 500 });
    const state = { value: { channel: "denoised" }, update: (change) => (state.value = change(state.value)) };
    const live = { job: "j", frame: 0, film: { total: 8 }, isRendering: true };
    const side = { state, live, fetching: new AbortController(), fetched: {}, previewAt: 0, filmHasMoreSamples: () => true };
    const before = performance.now();
    await m.PictureSide.prototype.fetch.call(side);
    globalThis.fetch = real;
    return [side.previewAt - before, state.value.waiting, String(state.value.error) !== "null"];"""


def test_preview_rests_after_a_failure(node: Node) -> None:
    rest_ms, waits, has_error = node.call("film/picture-side", FAILS)
    assert (waits, has_error) == (False, True)
    assert 9000 <= rest_ms <= 60_000


LOOKS = """
    const value = { channel: "denoised", isPreview: true, isLast: false };
    const state = { value, update: (change) => (state.value = change(state.value)) };
    const no = () => false;
    const idle = { isPreviewDue: no, isLastDue: no, goesOn: no, showsNoise: no, fetched: {}, layer: {} };
    m.PictureSide.prototype.lookAgain.call({ ...idle, state, live: { isRendering: a } });
    return state.value.isLast;"""


def test_preview_in_progress_is_the_last_once_rendering_has_ended(node: Node) -> None:
    """Otherwise the page would go on to say that it is renewed when its samples have doubled."""
    assert node.call("film/picture-side", LOOKS, True) is False
    assert node.call("film/picture-side", LOOKS, False) is True


DRAWS = """
    // A clock of its own: timers run in order, and a drawing takes a.ms until its fence is signalled.
    let now = 0, drawnAt = -Infinity;
    const timers = [], draws = [], real = [globalThis.setTimeout, performance.now];
    globalThis.setTimeout = (run, ms) => timers.push({ at: now + ms, run });
    performance.now = () => now;
    const until = (end) => {
      for (;;) {
        const next = timers.filter(({ at }) => at <= end).sort((p, q) => p.at - q.at)[0];
        if (!next) break;
        timers.splice(timers.indexOf(next), 1);
        now = next.at;
        next.run();
      }
      now = end;
    };
    const isDrawn = () => Number(now >= drawnAt + a.ms);
    const still = { flush() {}, deleteSync() {}, isContextLost: () => false };
    const gl = { ...still, SIGNALED: 1, fenceSync: () => ({}), getSyncParameter: isDrawn };
    const canvas = { gl, cover: { image: null }, sideBySide: false, wipe: a.wipe, resting: undefined, isOutdated: false };
    canvas.invalidate = () => {
      draws.push((drawnAt = now));
      canvas.isOutdated = false;
      m.FilmCanvas.prototype.rest.call(canvas);
    };
    for (let at = 0; at < 10_000; at += 20) {
      until(at);
      m.FilmCanvas.prototype.invalidateForTile.call(canvas, 0);
    }
    const during = draws.length;
    until(60_000);
    [globalThis.setTimeout, performance.now] = real;
    return { during, gaps: draws.slice(1).map((at, i) => at - draws[i]), after: draws.at(-1) };"""


def test_tiles_leave_at_least_half_of_the_time_idle(node: Node) -> None:
    def drawn(ms: int, wipe: float = 1) -> dict[str, object]:
        return node.call("film/film-canvas", DRAWS, {"ms": ms, "wipe": wipe})

    slow = drawn(700)
    assert 5 <= slow["during"] <= 8, "700 ms each, and 700 ms between"
    assert min(slow["gaps"]) >= 1400
    assert slow["after"] >= 9980, "the last tile is shown"
    fast = drawn(2)
    assert 50 <= fast["during"] <= 67, "a few times a second at most"
    assert drawn(2, wipe=0)["during"] == 0, "the layer is hidden"
