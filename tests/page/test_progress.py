"""Tests of a job's progress on the page: the latest of several descriptions, the remaining time, a stopped job's state."""

from __future__ import annotations

import pytest

from tests.page.node import Node

JOB = {"id": "j", "created": 1, "state": "running", "name": "n", "priority": 0, "progress": 0.5, "message": None}
JOB |= {"eta_s": 60, "active_s": 3}


def test_outdated_job_description_is_ignored(node: Node) -> None:
    """The page ignores a description of a job that is older than the one it has.

    Events and the job's socket deliver descriptions in no common order.
    """
    body = """
        m.jobs.set([]);
        for (const [samples, as_of] of a.steps) m.putJob({ ...a.job, samples, as_of });
        return m.jobs.value[0].samples;"""
    assert node.call("news/farm", body, {"job": JOB, "steps": [[5, 10.2], [4, 10.0], [6, 10.4], [5, 10.3]]}) == 6
    assert node.call("news/farm", body, {"job": JOB, "steps": [[5, 10.2], [5.5, 10.2]]}) == 5.5, "as new: the later one"
    assert node.call("news/farm", body, {"job": JOB, "steps": [[5, 9000], [6, 10]]}) == 6, "the service's clock was set back"


def test_new_state_of_a_job_is_news_whichever_connection_brings_it(node: Node) -> None:
    """Otherwise the number of running jobs stays if the job's own socket, or an answer, is faster than the farm's events."""
    body = """
        m.jobs.set([]);
        const news = [];
        for (const [put, state] of a.steps) {
            const before = m.jobNews.value;
            m[put]({ ...a.job, state });
            news.push(m.jobNews.value > before);
        }
        return news;"""
    steps = [["adoptJob", "queued"], ["adoptJob", "queued"], ["putJob", "running"], ["putJob", "running"], ["putJob", "finished"]]
    assert node.call("news/farm", body, {"job": JOB, "steps": steps}) == [True, False, True, False, True]


def test_late_answer_does_not_replace_a_newer_number_of_jobs(node: Node) -> None:
    body = """
        const { jobNews } = await read("/js/news/farm.js");
        const real = [globalThis.fetch, globalThis.setTimeout];
        const answers = [], timers = [];
        globalThis.fetch = () => new Promise((resolve, reject) => answers.push({ resolve, reject }));
        globalThis.setTimeout = (run) => timers.push(run);
        const settle = () => new Promise((resolve) => setImmediate(resolve));
        const say = (running) => new Response(JSON.stringify({ running }), { status: 200 });
        const tell = () => (jobNews.update((n) => n + 1), timers.splice(0).forEach((run) => run()));
        try {
            m.followTallies();
            timers.splice(0).forEach((run) => run());
            tell();
            answers[1].resolve(say(0));
            await settle();
            answers[0].resolve(say(1));
            await settle();
            const kept = m.tallies.value.running;
            tell();
            answers[2].resolve(new Response("{}", { status: 500 }));
            await settle();
            timers.splice(0).forEach((run) => run());
            answers[3]?.resolve(say(2));
            await settle();
            return [kept, m.tallies.value.running];
        } finally {
            [globalThis.fetch, globalThis.setTimeout] = real;
        }"""
    assert node.call("news/job-list", body) == [0, 2], "and a query that failed is repeated"


def test_only_pictures_with_lights_to_mix_have_a_tab_for_them(node: Node) -> None:
    """A picture has the tab if it has light groups, or its scene has lights to group, known from the list of scenes."""
    body = """
        const { scenes } = await read("/js/news/farm.js");
        const job = { scene: "s", settings: { light_groups: a.groups } };
        scenes.set(a.scene ? [{ id: "s", light_groups: a.scene.groups_of_scene }] : null);
        return m.canMixLights(job);"""

    def can_mix(groups: str = "", **scene: object) -> bool:
        found: bool = node.call("job/light-mixer", body, {"groups": groups, "scene": scene or None})
        return found

    assert not can_mix()
    assert can_mix("key,fill")
    assert can_mix("key,fill", groups_of_scene=[])
    assert not can_mix(groups_of_scene=[])
    assert can_mix(groups_of_scene=["environment", "lamp"])


def test_remaining_time_is_smoothed(node: Node) -> None:
    """The displayed remaining time hardly follows a short disturbance.

    A forecast that is three times as long for five seconds adds at most a fifth of the difference; after two minutes it is
    adopted.
    """
    body = """
        const end = new m.SmoothedEnd();
        const shown = [];
        a.forEach((left, second) => (end.add(left, second), shown.push(end.left(second))));
        return shown;"""
    shown = node.call("news/time-left", body, [1800] * 10 + [5400] * 5 + [1800] * 25)
    assert shown[0] == 1800
    assert max(shown) < 1800 + 0.2 * 3600
    lasting = node.call("news/time-left", body, [1800] + [5400 - second for second in range(120)])
    assert lasting[-1] == pytest.approx(5400 - 119, rel=0.02), "what lasts is believed after four times 30 s"


def test_remaining_time_is_rounded(node: Node) -> None:
    body = "return a.map((seconds) => m.rounded(seconds));"
    seconds = [0.4, 3, 43, 75, 104, 130, 1790, 2740, 3 * 3600]
    assert node.call("news/time-left", body, seconds) == [0, 5, 45, 80, 100, 120, 1800, 2700, 3 * 3600]


def test_remaining_time_rises_seldom_and_little(node: Node) -> None:
    """A value stays for five seconds before it rises, by a quarter at most.

    If the forecast doubles, the farm has changed, and the value follows.
    """
    body = """
        const end = new m.SmoothedEnd();
        return a.map(([left, now]) => ((end.end = now + left), end.steady(now)));"""
    assert node.call("news/time-left", body, [[40, 0], [44, 1], [58, 3], [58, 6], [58, 7]]) == [40, 40, 40, 50, 50]
    assert node.call("news/time-left", body, [[40, 0], [300, 1], [300, 6], [20, 7]]) == [40, 40, 300, 20]
    assert node.call("news/time-left", body, [[5, 0], [8, 6]]) == [5, 5]


def test_remaining_time_is_shown_once_it_is_known(node: Node) -> None:
    body = "m.noteForecast(a, a.denoising, 100); return m.timeLeft(a.id, 100);"
    assert node.call("news/time-left", body, {**JOB, "eta_s": 2690}) == "about 45 min"
    assert node.call("news/time-left", body, {**JOB, "id": "k", "eta_s": 104}) == "about 100 s"
    assert node.call("news/time-left", body, {**JOB, "progress": 0.04}) == ""
    assert node.call("news/time-left", body, {**JOB, "progress": 0.15}) == "", "of a short job, the first samples say little"
    assert node.call("news/time-left", body, {**JOB, "active_s": 2.5}) == "", "in the first seconds"
    assert node.call("news/time-left", body, {**JOB, "active_s": 4, "eta_s": 5}) == "", "it ends soon"
    assert node.call("news/time-left", body, {**JOB, "id": "s", "active_s": 4, "eta_s": 7}) == "about 5 s"
    assert node.call("news/time-left", body, {**JOB, "id": "d", "active_s": 4, "eta_s": 5, "denoising": 6}) == "about 10 s"
    assert node.call("news/time-left", body, {**JOB, "id": "e", "active_s": 20, "eta_s": 2}) == "a few seconds"
    assert node.call("news/time-left", body, {**JOB, "progress": 0.06, "active_s": 25}) == "about 60 s"
    taken = {**JOB, "progress": 0.52, "spp": 64, "taken": {"spp": 32}}
    assert node.call("news/time-left", body, taken) == "", "it has done 4 % itself"
    assert node.call("news/time-left", body, {**JOB, "message": "Waits for a worker."}) == ""
    assert node.call("news/time-left", body, {**JOB, "state": "paused"}) == ""


def test_frame_is_paused_with_its_job(node: Node) -> None:
    body = """
        const job = (state) => ({ state, shot: { frames: "0-3" } });
        const frames = new m.ShotFrames(job("running"));
        frames.take(["finished", "running", "preparing", "queued"].map((state, number) => ({ number, state })));
        frames.update(job(a));
        return [0, 1, 2, 3].map((number) => frames.shown(number).state);"""
    assert node.call("shot/shot-frames", body, "running") == ["finished", "running", "preparing", "queued"]
    assert node.call("shot/shot-frames", body, "paused") == ["finished", "paused", "paused", "queued"]


def test_new_job_shows_live_view_picture(node: Node) -> None:
    body = """
        const { Film } = await read("/js/film/film.js");
        const view = new Film(2, 1, new Uint32Array([7, 9]));
        view.isBlank = a.isBlank;
        m.keepFirstLook("new", { film: view, isSame: false, clean: "" });
        const film = new Film(4, 2);
        const [other, own, again] = ["old", "new", "new"].map((job) => m.takeFirstLook(job));
        if (own) film.restart(own.film);
        return [other, again, own?.isSame ?? null, [...film.words], film.isBlank, film.total];"""
    assert node.call("film/first-look", body, {"isBlank": False}) == [None, None, False, [7, 7, 9, 9] * 2, False, 0]
    assert node.call("film/first-look", body, {"isBlank": True}) == [None, None, None, [0] * 8, True, 0]


def test_upload_that_ended_is_listed_again_when_it_is_repeated(node: Node) -> None:
    body = """
        const upload = m.arrive("truck.glb");
        const lengths = [upload.end, upload.begin, upload.begin, upload.end].map((change) => (change(), m.arriving.value.length));
        return lengths;"""
    assert node.call("news/arriving", body) == [0, 1, 1, 0]
