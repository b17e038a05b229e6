"""Tests of texts that the page formats and parses: numbers, times, frame ranges, shortcuts, messages of the service."""

from __future__ import annotations

import json
from typing import Any

import pytest

from renderer import aovs
from renderer.errors import SettingsError
from renderer.frames import frames_text, parse_frames
from tests.helpers import ROOT
from tests.page.node import Node


def test_rejected_files_message_uses_plural(node: Node) -> None:
    body = "return m.notUploadedTitle(a.map((path) => ({ path })));"
    assert node.call("shell/gather-files", body, ["room.obj"]) == "room.obj was not accepted"
    assert node.call("shell/gather-files", body, ["a.png", "room.obj", "b.png"]) == "room.obj and 2 more were not accepted"


def test_upload_time_follows_recent_speed(node: Node) -> None:
    """The estimated time of an upload follows from its speed in the last seconds, although it was faster before."""
    body = """
        const pace = new m.Pace(1_000_000);
        return a.map(([sent, at]) => { pace.put(sent, at); return pace.now; });"""
    fast = [[0, 0], [100_000, 500], [400_000, 2000]]
    slow = [[400_000 + 10_000 * s, 2000 + 1000 * s] for s in range(1, 11)]
    found = node.call("shell/upload-pace", body, fast + slow)
    assert found[:2] == [None, None]
    assert found[2] == {"speed": 200_000, "left": 3}
    assert found[-1]["speed"] == pytest.approx(10_000) and found[-1]["left"] == pytest.approx(50)
    assert node.call("shell/upload-pace", body, [[0, 0], [5, 100], [5, 9000]])[-1] is None, "it stands still"


def test_single_letter_shortcuts_can_be_disabled(node: Node) -> None:
    body = """
        const done = [];
        const shortcut = (keys) => ({ keys, does: keys, run: () => done.push(keys) });
        const off = m.addShortcuts(["E", "?", "ArrowUp", "Escape"].map(shortcut));
        for (const act of [true, false, true]) {
            m.setLetterShortcuts(act);
            for (const key of ["e", "?", "ArrowUp", "Escape"]) dispatchEvent(new KeyboardEvent("keydown", { key }));
            done.push(m.hasLetterShortcuts());
        }
        off();
        return done;"""
    all_of_them = ["E", "?", "ArrowUp", "Escape", True]
    assert node.call("shell/shortcuts", body) == [*all_of_them, "ArrowUp", "Escape", False, *all_of_them]


def test_digit_keys_are_the_same_on_every_keyboard(node: Node) -> None:
    """A French keyboard types "&" with the key of 1, and "1" with Shift; a German one types "/" with Shift and 7."""
    body = """
        const done = [];
        const off = m.addShortcuts(["1", "Shift+1", "/"].map((keys) => ({ keys, does: keys, run: () => done.push(keys) })));
        for (const each of a) dispatchEvent(new KeyboardEvent("keydown", each));
        off();
        return done;"""
    french = [{"key": "&", "code": "Digit1"}, {"key": "1", "code": "Digit1", "shiftKey": True}]
    english = [{"key": "1", "code": "Digit1"}, {"key": "!", "code": "Digit1", "shiftKey": True}]
    others = [{"key": "/", "code": "Digit7", "shiftKey": True}, {"key": "1", "code": "Numpad1"}]
    assert node.call("shell/shortcuts", body, french + english + others) == ["1", "Shift+1"] * 2 + ["/", "1"]


def test_shortcuts_have_groups_which_the_help_lists(node: Node) -> None:
    body = """
        const shortcut = (keys, shown) => ({ keys, does: keys, get shown() { return shown; }, run: () => {} });
        const offs = [m.addShortcuts([shortcut("P", null)], "picture"), m.addShortcuts([shortcut("U", "u")])];
        const listed = m.shortcuts().map(({ keys, shown, group }) => [keys, shown, group]);
        for (const off of offs) off();
        return [listed, m.shortcuts()];"""
    assert node.call("shell/shortcuts", body) == [[["P", None, "picture"], ["U", "u", "page"]], []]


def test_durations_are_formatted_briefly(node: Node) -> None:
    times = node.call("base/format", "return a.map(m.clock);", [7, 125, 3725, 47 * 3600, 622 * 3600 + 1098])
    assert times == ["0:07", "2:05", "1:02:05", "47:00:00", "25 d 22 h"]


def test_expected_times_are_rounded(node: Node) -> None:
    times = [0.2, 4.2, 13, 17, 26, 50, 85, 130, 700, 5000, 20_000, 1e6]
    shown = ["1 s", "5 s", "15 s", "15 s", "30 s", "45 s", "1.5 min", "2 min", "10 min", "1.5 h", "5 h", "10 d"]
    assert node.call("forms/expected-time", "return a.map(m.expectedText);", times) == shown


EXPECTED = """
    const { HeldMeasurement, expected, expectedText, rangeText } = m;
    const worker = { slots: 2 };
    const held = new HeldMeasurement();
    return a.series.map(([ofView, measured]) => {
        held.ofView = ofView;
        const picture = { pixels: 5e5, spp: a.spp ?? 64, isDenoised: a.denoised ?? false };
        const { seconds, isSure } = expected({ id: "s", measured }, held, a.others ?? [], a.workers ?? [worker], picture);
        return seconds === null ? "" : isSure ? expectedText(seconds) : rangeText(seconds);
    });"""


@pytest.mark.parametrize(
    ("given", "times"),
    [
        # The first measurement, of the view or of the scene's pictures, holds until the page is left.
        ({"series": [[None, None], [1e-6, None], [9e-6, None], [9e-6, {"sample_s": 9e-6}]]}, ["", *["15 to 30 s"] * 3]),
        ({"series": [[9e-6, {"sample_s": 1e-6}], [9e-6, {"sample_s": 5e-6}]]}, ["20 s", "20 s"]),
        # `pace` scales the time of the batches; the last denoised picture adds that of the scene's, or else of others'.
        ({"series": [[None, {"sample_s": 1e-6, "pace": 2}]]}, ["30 s"]),
        ({"series": [[None, {"sample_s": 1e-6, "pace": 1, "denoise_s": 3e-5}]], "denoised": True}, ["30 s"]),
        ({"series": [[None, {"sample_s": 1e-6, "pace": 1, "denoise_s": 3e-5}]]}, ["15 s"]),
        ({"series": [[None, {"sample_s": 1e-7, "pace": 1}]], "denoised": True}, ["7 s"]),
        (  # more machines do not denoise faster, since one denoises it
            {"series": [[None, {"sample_s": 1e-7, "pace": 1}]], "denoised": True, "workers": [{"slots": 2}] * 8},
            ["7 s"],
        ),
        (
            {
                "series": [[None, {"sample_s": 1e-7, "pace": 1}]],
                "denoised": True,
                "others": [{"measured": {"denoise_s": s}} for s in (9e-5, 2e-5, 1e-9)] + [{"measured": None}],
            },
            ["15 s"],
        ),
        ({"series": [[None, {"sample_s": 1e-6}]], "workers": []}, [""]),
        ({"series": [[1e-5, None]]}, ["2 min to 5 min"]),
        ({"series": [[1e-12, None]]}, ["1 s"]),
    ],
)
def test_expected_time_is_that_of_the_last_picture(program: str, given: dict[str, Any], times: list[str]) -> None:
    with Node(program, "en-GB") as fresh:
        assert fresh.call("forms/expected-time", EXPECTED, given) == times


def test_scene_size_is_formatted_briefly(node: Node) -> None:
    extents = node.call("base/format", "return a.map(m.extent);", [[4, 3, 2.54321], [4e5, 3e5, 12], [0, 0, 0], [2e-5, 0, 1e-7]])
    assert extents == ["4 × 3 × 2.54", "4 × 3 × 0.00012 · 10⁵", "0 × 0 × 0", "2 × 0 × 0.01 · 10⁻⁵"]


@pytest.mark.parametrize(("locale", "shown"), [("de-DE", "1\u202f234\u202f567"), ("en-GB", "1,234,567"), ("zh-CN", "1,234,567")])
def test_decimal_comma_is_no_thousands_separator(program: str, locale: str, shown: str) -> None:
    with Node(program, locale) as node:
        assert node.call("base/format", "return m.count(a)", 1_234_567) == shown
        assert node.call("base/format", "return m.compact(a)", 1_234_567) == "1.23 M"


TEXTS = ["0-99", "7", "1-250x5,300", "0-2x0.5", "12.5, 3-4", "5,5,4-6", "9-3", "3-", "", "a", "1-9x0", "0-100000"]


def test_frame_ranges_are_parsed_as_by_renderer(node: Node) -> None:
    for text, got in zip(
        TEXTS, node.call("base/frame-numbers", "return a.map((text) => m.parseFrames(text));", TEXTS), strict=True
    ):
        try:
            wanted = parse_frames(text)
        except SettingsError:
            assert isinstance(got, str), f"a sentence about {text!r}"
        else:
            assert got == wanted, text
            again = node.call("base/frame-numbers", "return m.framesText(a);", wanted)
            assert again == frames_text(wanted), text


def test_service_errors_are_shown_in_german(german: Node) -> None:
    problem = (
        '{"title": "Insufficient Storage", "detail": "The upload is empty.", "status": 507, '
        '"code": "upload-without-files", "params": {}}'
    )
    told = german.call("news/api", "return m.errorOf(507, a).message;", problem)
    assert told == json.loads((ROOT / "web/words/service.de.json").read_text(encoding="utf-8"))["upload-without-files"]


def test_channels_equal_service_list(node: Node) -> None:
    body = """
        const { inWords, table } = await read("/js/news/settings-table.js");
        const before = m.channels().map(({ name }) => name);
        const defaults = { width: 960, height: 540, spp: 64 };
        table.set(inWords({ defaults, settings: [], view: [], work: [], shot: [], channels: a }));
        const shown = m.channels();
        table.set(null);
        return [before, shown];"""
    before, shown = node.call("film/channels", body, aovs.described())
    assert before == [""]
    assert [channel["name"] for channel in shown] == ["", *aovs.AOVS]
    assert shown[3] == {
        "name": "depth",
        "label": "Depth",
        "help": "Distance from the eye to the first surface",
        "values": ["Distance"],
    }


def test_quality_of_a_compared_picture_is_what_it_has(node: Node) -> None:
    """A comparison states the samples that a picture has; the list of jobs states the goal of a job that is not stopped."""
    body = """
        const work = [{ name: "spp", of: "work", phrase: "{}" }, { name: "noise", of: "work", phrase: "noise {}" }];
        m.table.set({ defaults: {}, settings: [], view: [], work, shot: [], channels: [] });
        const job = { width: 8, height: 4, samples: 32 * 67, spp: 1024, shot: null };
        const said = a.map((own) => ({ ...job, ...own })).map((each) => [m.reached(each), m.shownQuality(each)]);
        m.table.set(null);
        return said;"""
    goal, now, part = "1,024 samples", "67 samples", "67 of 1,024 samples"
    states = [{"state": state} for state in ("cancelled", "paused", "running", "queued", "finished")]
    by_noise = [
        {"state": state, "noise": 0.01, "spp": spp} for state, spp in (("running", None), ("running", 1024), ("paused", None))
    ]
    assert node.call("news/settings-table", body, states + by_noise) == [
        [now, now],
        [now, now],
        [goal, part],
        [goal, part],
        [goal, goal],
        ["noise 0.01", f"{now} until noise 0.01"],
        ["noise 0.01", f"{now} until noise 0.01"],
        [now, now],
    ]


def test_place_of_an_error_is_said_where_its_sentence_does_not(node: Node) -> None:
    body = "return a.map(([error, params]) => m.placeOf({ error, codes: { error: { params } }, main: 'a.usda' }));"
    found = node.call(
        "scene/failed-scene",
        body,
        [
            ["b.usda:11:9: expected a comma", {"name": "b.usda"}],
            ["expected a comma", {"file": "c.xml", "error": {"code": "e", "params": {"line": 3}}}],
            ["a.usda is damaged (line 11, column 9)", {"error": {"params": {"line": 11, "column": 9}}}],
            ["it has no shapes", {}],
        ],
    )
    assert found == [{"file": "b.usda", "line": 11, "column": 9}, {"file": "c.xml", "line": 3, "column": None}, None, None]
