"""Tests of job templates of OpenJD: those written are valid and run as such; a farm takes what calls `rayfarm render` alone."""

from __future__ import annotations

import json
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import yaml
from openjd.model import IntRangeExpr, create_job, decode_job_template, preprocess_job_parameters
from openjd.model import StepParameterSpaceIterator as Tasks
from openjd.sessions import ActionState, Session, SessionState

from rayfarm.client import Client
from rayfarm.errors import CommandError
from rayfarm.job_template import is_template, parsed_options, range_expression, read_template, render_command, template_of
from rayfarm.picture import Picture
from renderer.errors import SettingsError
from renderer.frames import parse_frames
from renderer.settings import View
from service.intake import render_words
from service.models.jobs import JobIn
from tests.helpers import ROOT, Farm, code_of
from tests.rayfarm.program import rayfarm
from tests.rayfarm.test_sequence import animated_scene
from tests.rayfarm.test_with_farm import pixels

WIDE = View((0, 1, 5), (0, 1, 0), (0, 1, 0), 60.0)
CORNELL = ROOT / "scenes" / "cornell-box.yaml"
Edit = Callable[[dict[str, Any]], Any]


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    (tmp_path / "shot.glb").write_bytes(animated_scene().glb())
    return tmp_path


def job_of(template: dict[str, Any], folder: Path, **values: str) -> tuple[Any, Any]:
    """Returns the job that OpenJD's own library makes of a template, and its parameters."""
    decoded = decode_job_template(template=template, supported_extensions=["TASK_CHUNKING"])
    parameters = preprocess_job_parameters(
        job_template=decoded, job_parameter_values=values, job_template_dir=folder, current_working_dir=folder
    )
    return create_job(job_template=decoded, job_parameter_values=parameters), parameters


def run_tasks(job: Any, parameters: Any, folder: Path) -> list[Any]:
    """Runs all tasks of a job's only step in one session of OpenJD's runtime; returns what its tasks ended with."""
    step, ended, states = job.steps[0], threading.Event(), []

    def note(session: str, status: Any) -> None:
        if status.state not in (ActionState.RUNNING,):
            states.append(status.state)
            ended.set()

    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    with Session(
        session_id="test",
        job_parameter_values=parameters,
        callback=note,
        session_root_directory=folder,
        os_env_vars={"PATH": path},
    ) as session:
        for task in Tasks(space=step.parameterSpace):
            assert session.state is SessionState.READY
            ended.clear()
            session.run_task(step_script=step.script, task_parameter_values=task)
            assert ended.wait(120)
    return states


def test_the_runtime_of_openjd_renders_what_render_does(shot: Path) -> None:
    done = rayfarm(
        "openjd", shot / "shot.glb", "-o", shot / "far.###.exr", "--frames=0-2x2", "--size=24x16", "--spp=4", "--env=1,1,1",
        "--chunk=2", "--template", shot / "job.yaml",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    job, parameters = job_of(yaml.safe_load((shot / "job.yaml").read_text()), shot)
    assert [sorted(IntRangeExpr.from_str(task["Frame"].value)) for task in Tasks(space=job.steps[0].parameterSpace)] == [[0, 2]]
    assert run_tasks(job, parameters, shot) == [ActionState.SUCCESS]
    arguments = ["--frames=0,2", "--size=24x16", "--spp=4", "--env=1,1,1"]
    assert rayfarm("render", shot / "shot.glb", "-o", shot / "near.###.exr", *arguments).returncode == 0
    for number in ("000", "002"):
        assert np.array_equal(pixels(shot / f"far.{number}.exr"), pixels(shot / f"near.{number}.exr"))
    assert not np.array_equal(pixels(shot / "far.000.exr"), pixels(shot / "far.002.exr")), "the triangle moves"


def test_a_farm_takes_the_template_as_a_shot(farm: Farm, shot: Path) -> None:
    words = [str(shot / "shot.glb"), "-o", str(shot / "far.#.exr"), "--frames=0-8x2", "--size=24x16", "--spp=4", "--env=1,1,1"]
    template, missing = template_of([*words, "--eye=-1,0,5", "--target=0,0,0", "--no-floor"], shot)
    assert missing == []
    (shot / "job.json").write_text(json.dumps(template))
    done = rayfarm("submit", shot / "job.json", "--param", "Frames=1-3:2", "--wait", "--server", farm.url)
    assert done.returncode == 0, done.stderr
    with farm.client() as client:
        job = client.job(done.stdout.strip())
        assert [frame.number for frame in client.frames(job.id)] == [1, 3]
        assert (job.width, job.height, job.spp) == (24, 16, 4)
        assert job.settings is not None and job.settings["view"]["eye"] == [-1, 0, 5]
        check_rest(farm, job.scene, template, job.settings)
        check_steps(farm, client, shot, template)
    near = ["--frames=1,3", "--size=24x16", "--spp=4", "--env=1,1,1", "--eye=-1,0,5", "--target=0,0,0"]
    assert rayfarm("render", shot / "shot.glb", "-o", shot / "near.#.exr", *near).returncode == 0
    for number in (1, 3):
        assert np.array_equal(pixels(shot / f"far.{number}.exr"), pixels(shot / f"near.{number}.exr"))
    assert not (shot / "far.0.exr").exists()


def check_steps(farm: Farm, client: Client, shot: Path, template: dict[str, Any]) -> None:
    """Checks that each step of a template becomes a job, after those of the steps on which it depends."""
    first = {**template["steps"][0], "name": "First"}
    second = {**first, "name": "Second", "dependencies": [{"dependsOn": "First"}]}
    steps = {**template, "steps": [second, first]}
    (shot / "steps.json").write_text(json.dumps(steps))
    done = rayfarm("submit", shot / "steps.json", "--need", "nowhere", "--param", "Frames=5-6", "--server", farm.url)
    assert done.returncode == 0, done.stderr
    before, behind = (client.job(id) for id in done.stdout.split())
    assert (behind.after, before.after) == ([before.id], [])
    with httpx.Client(base_url=farm.url) as http:
        body = {"scene": before.scene, "template": steps, "needs": ["nowhere"]}
        made = http.post("/api/jobs/openjd", json={**body, "step": "Second", "after": [before.id]}).json()
        assert (made["name"], made["after"]) == ("shot.glb: Second", [before.id])
        for change, code in (({}, "template-step-unnamed"), ({"step": "Third"}, "template-step-unknown")):
            problem = http.post("/api/jobs/openjd", json={**body, **change}).json()
            assert problem["params"]["sentence"]["code"] == code, problem
        for id in (made["id"], behind.id, before.id):
            http.delete(f"/api/jobs/{id}").raise_for_status()


def check_rest(farm: Farm, scene: str, template: dict[str, Any], settings: dict[str, Any]) -> None:
    """Checks that POST /api/jobs/openjd makes the same job as `rayfarm submit`, and refuses by a coded sentence."""
    body = {"scene": scene, "template": template, "parameters": {"Frames": "1-3:2"}, "needs": ["nowhere"], "priority": -3}
    with httpx.Client(base_url=farm.url) as http:
        answer = http.post("/api/jobs/openjd", json=body)
        assert answer.status_code == 201, answer.text
        job = answer.json()
        assert answer.headers["Location"] == f"/api/jobs/{job['id']}"
        assert job["settings"] == settings
        assert (job["shot"]["frames"], job["needs"], job["priority"], job["name"]) == ("1,3", ["nowhere"], -3, "shot.glb")
        http.delete(f"/api/jobs/{job['id']}").raise_for_status()
        wrong = json.loads(json.dumps(template).replace("--spp", "--sparkle"))
        for change, code in (
            ({"template": wrong}, "template-option-unknown"),
            ({"parameters": {"Frames": "1-99999999999"}}, "template-frames-many"),
            ({"parameters": {"Frames": "9" * 400}}, "frame-invalid"),
            ({"parameters": {"Frames": "1-" + "9" * 400}}, "template-invalid"),
            ({"template": {}}, "template-invalid"),
            ({"scene": "none"}, "scene-id-unknown"),
        ):
            problem = http.post("/api/jobs/openjd", json={**body, **change}).json()
            sentence = problem["params"].get("sentence", problem)
            assert code in (problem["code"], sentence["code"]), problem
        check_hostile(http, body)
        many = json.loads(json.dumps(template).replace('"4"', '"0"'))
        assert http.post("/api/jobs/openjd", json={**body, "template": many}).json()["errors"][0]["field"] == "spp"


def check_hostile(http: httpx.Client, body: dict[str, Any]) -> None:
    """Checks that templates that are too large, too deep or no JSON are refused before OpenJD's library reads them."""
    deep: Any = 1
    for _ in range(500):
        deep = [deep]
    template = body["template"]
    long = json.loads(json.dumps(template))
    long["steps"][0]["script"]["actions"]["onRun"]["args"] += ["--camera", "{{Param.Frames}}" * 1000]
    for change, code in (
        ({**template, "steps": deep}, "template-too-large"),
        ({**template, "steps": [0] * 300_000}, "template-too-large"),
        ({**template, "description": "{{a}}" * 9000}, "template-too-large"),
        (long, "template-too-large"),
        ({**template, "steps": [{"min": float("nan")}]}, "template-number-not-finite"),
        ({**template, "\ud800": 1}, "template-invalid"),
    ):
        content = json.dumps({**body, "template": change, "parameters": {"Frames": "0" * 1000 + "1"}})
        answer = http.post("/api/jobs/openjd", content=content, headers={"Content-Type": "application/json"})
        assert answer.status_code == 422
        assert answer.json()["params"]["sentence"]["code"] == code, answer.text


def test_the_rest_api_takes_the_options_of_render() -> None:
    """Every option of `rayfarm render` is translated, left out on purpose, or refused; with the values that `submit` sends."""
    command = render_command()
    for parameter in command.params:
        for option in (*parameter.opts, *parameter.secondary_opts):
            if option.startswith("--") and "completion" not in option:
                is_flag = option[2:] in render_words.FLAGS
                assert is_flag or option[2:] in render_words.VALUES, option
                assert is_flag == bool(getattr(parameter, "is_flag", False)) or option[2:] in render_words.LOCAL_ONLY, option
    cameras = [{"name": "left", "view": dict(WIDE.to_json())}, {"name": "right", "view": {**WIDE.to_json(), "fov": 20.0}}]
    for words in (
        ["--size=24x16", "--spp", "4", "--clamp=3", "--ambient", "1,2,3", "--env=sky:30,90", "--env-strength=2"],
        ["--env", "1,1,1", "--camera=right", "--time-limit=2.5", "--light-groups=key,fill", "--integrator", "ao"],
        ["--camera=1", "--eye=-1,0,5", "--distortion=brown,-0.2,0.05", "--noise=0.1", "--env=noon", "--max-depth=2"],
    ):
        wanted = Picture(parsed_options(words)).request(cameras)
        found = render_words.request_fields(["scene.glb", *words, "-o", "a.png", "--overwrite"], cameras)
        if "camera" in wanted:
            wanted["camera"] = cameras[wanted["camera"]]["name"]
        bodies = [JobIn(scene="x", **each).model_dump(mode="json") for each in (wanted, found)]
        assert bodies[0] == bodies[1], words
    for words, code in (
        (["a.glb", "--eye=1,2"], "template-option-invalid"),
        (["a.glb", "--size=2"], "template-option-invalid"),
        (["a.glb", "--env=sky.exr"], "template-environment-file"),
        (["a.glb", "--fov=2"], "template-view-unprepared"),
        (["a.glb", "--gpu"], "template-option-local"),
        (["a.glb", "--spp"], "template-option-empty"),
        (["a.glb", "--denoise=no"], "template-option-flag"),
        (["a.glb", "b.glb"], "template-scene-count"),
    ):
        with pytest.raises(SettingsError) as refused:
            render_words.request_fields(words, None)
        assert code_of(refused.value) == code


def test_a_still_is_one_task(tmp_path: Path) -> None:
    (tmp_path / "sky.exr").write_bytes(b"")
    (tmp_path / "box.yaml").write_text("shapes: [{type: sphere}]\n")
    words = [str(tmp_path / "box.yaml"), "-o", str(tmp_path / "a.png"), "--env", str(tmp_path / "sky.exr"), "--frame=7"]
    template, missing = template_of(words, tmp_path)
    job, _ = job_of(template, tmp_path)
    assert job.steps[0].parameterSpace is None
    assert missing == []
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(template))
    (call,) = read_template(tmp_path / "job.yaml")
    assert (call.frames, call.options["frame"], call.options["env"]) == (None, 7, str(tmp_path / "sky.exr"))
    assert call.options["scene"] == tmp_path / "box.yaml"


def test_paths_outside_the_templates_folder_have_no_default(shot: Path, tmp_path: Path) -> None:
    (tmp_path / "jobs").mkdir()
    template, missing = template_of(
        [str(shot / "shot.glb"), "--frames=1-2", "-o", str(tmp_path / "jobs/a.#.png")], tmp_path / "jobs"
    )
    assert missing == ["Scene"]
    (tmp_path / "jobs" / "job.yaml").write_text(yaml.safe_dump(template))
    with pytest.raises(CommandError, match="Scene"):
        read_template(tmp_path / "jobs" / "job.yaml")
    assert (
        read_template(tmp_path / "jobs" / "job.yaml", {"Scene": str(shot / "shot.glb")})[0].options["scene"] == shot / "shot.glb"
    )


@pytest.mark.parametrize("frames", ["1-10:2", "7", "0-99", "1-250x5,300", "1,2,3,5,8,13", "100000-100010:5", "3-9:3,10-12"])
def test_a_range_expression_names_the_same_frames(frames: str) -> None:
    numbers = parse_frames(frames)
    assert sorted(IntRangeExpr.from_str(range_expression(numbers))) == sorted(numbers)


def test_what_a_template_cannot_say_is_refused(tmp_path: Path) -> None:
    for words, said in (
        (["--frames=0-2x0.5", "-o", "a.#.png"], "whole numbers"),
        (["--frames=0-2", "-o", "a.mp4"], "not one film"),
        (["--frames=0-2", "-o", "a.png"], "Write ####"),
        (["--frames=0-2", "--frame=2"], "both given"),
        (["--camera={{x}}"], "begins an expression"),
        (["--spp=many"], "does not take this"),
        ([f"--frames={','.join(str(n * n) for n in range(500))}", "-o", "a.#.png"], "split them"),
    ):
        with pytest.raises(CommandError, match=said):
            template_of([str(CORNELL), *words], tmp_path)
    with pytest.raises(CommandError, match="a still is one task"):
        template_of([str(CORNELL)], tmp_path, chunk=2)


def arguments(template: dict[str, Any]) -> list[str]:
    words: list[str] = template["steps"][0]["script"]["actions"]["onRun"]["args"]
    return words


REFUSED: dict[str, tuple[Edit, str]] = {
    "a step of another program": (
        lambda t: t["steps"].append({"name": "More", "script": {"actions": {"onRun": {"command": "ls"}}}}),
        "command `ls`",
    ),
    "a circle": (
        lambda t: t["steps"][0].update(dependencies=[{"dependsOn": t["steps"][0]["name"]}]),
        "not a valid job template",
    ),
    "another program": (lambda t: t["steps"][0]["script"]["actions"]["onRun"].update(command="bash"), "command `bash render"),
    "another command": (lambda t: arguments(t).__setitem__(0, "up"), "command `rayfarm up"),
    "an unknown option": (lambda t: arguments(t).append("--sparkle"), "--sparkle"),
    "a local option": (lambda t: arguments(t).extend(["--threads", "2"]), "--threads is not supported by a farm"),
    "files in it": (
        lambda t: t["steps"][0]["script"].update(embeddedFiles=[{"name": "F", "type": "TEXT", "data": "x"}]),
        "embeddedFiles is not supported",
    ),
    "an environment": (
        lambda t: t.update(jobEnvironments=[{"name": "E", "variables": {"A": "b"}}]),
        "jobEnvironments is not supported",
    ),
    "a timeout": (lambda t: t["steps"][0]["script"]["actions"]["onRun"].update(timeout=60), "timeout is not supported"),
    "a session's folder": (lambda t: arguments(t).extend(["--root", "{{Session.WorkingDirectory}}"]), "job and task parameters"),
    "two task parameters": (
        lambda t: t["steps"][0]["parameterSpace"]["taskParameterDefinitions"].append(
            {"name": "Seed", "type": "INT", "range": "1-2"}
        ),
        "task parameters Frame, Seed",
    ),
    "a task parameter elsewhere": (lambda t: arguments(t).extend(["--seed", "{{Task.Param.Frame}}"]), "is in --seed"),
    "another frame": (lambda t: arguments(t).append("--frames=7"), "--frames is given beside the task's frame"),
    "negative frames": (lambda t: t["parameterDefinitions"][-1].update(default="-3-3"), "begin at 0"),
    "a wrong range": (lambda t: t["parameterDefinitions"][-1].update(default="many"), "not a valid job template"),
    "a requirement": (
        lambda t: t["steps"][0].update(hostRequirements={"amounts": [{"name": "amount.worker.gpu", "min": 1}]}),
        "the requirement amount.worker.gpu",
    ),
    "another system": (
        lambda t: t["steps"][0].update(
            hostRequirements={"attributes": [{"name": "attr.worker.os.family", "anyOf": ["windows", "macos"]}]}
        ),
        "the requirement attr.worker.os.family: windows, macos",
    ),
    "one tag of two": (
        lambda t: t["steps"][0].update(hostRequirements={"attributes": [{"name": "attr.rayfarm.tags", "anyOf": ["a", "b"]}]}),
        "the requirement attr.rayfarm.tags",
    ),
    "no steps": (lambda t: t.pop("steps"), "not a valid job template"),
    "an older version": (lambda t: t.update(specificationVersion="jobtemplate-1999-01"), "not a valid job template"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_a_template_that_is_no_shot_is_refused_by_a_sentence_about_its_part(name: str, tmp_path: Path) -> None:
    edit, said = REFUSED[name]
    (tmp_path / "box.yaml").write_text("shapes: [{type: sphere}]\n")
    template, _ = template_of([str(tmp_path / "box.yaml"), "-o", str(tmp_path / "a.#.png"), "--frames=1-3"], tmp_path)
    template["parameterDefinitions"] = list(template["parameterDefinitions"])
    edit(template)
    (tmp_path / "job.yaml").write_text(yaml.safe_dump(template))
    done = rayfarm("submit", tmp_path / "job.yaml", "--server", "http://127.0.0.1:9", COLUMNS="400")
    assert done.returncode == 1
    assert said in done.stderr, done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_requirements_become_needs(tmp_path: Path) -> None:
    (tmp_path / "box.yaml").write_text("shapes: [{type: sphere}]\n")
    template, _ = template_of([str(tmp_path / "box.yaml")], tmp_path)
    template["parameterDefinitions"][1]["default"] = "a.png"
    attributes = [
        {"name": "attr.worker.os.family", "anyOf": ["linux", "windows"]},
        {"name": "attr.worker.cpu.arch", "allOf": ["x86_64"]},
        {"name": "attr.rayfarm.tags", "allOf": ["bigmem", "scratch"]},
    ]
    for mebibytes, memory in ((30518, "memory_gb=32"), (65536, "memory_gb=68.719")):
        needs = ["bigmem", "scratch", memory]
        amounts = [{"name": "amount.worker.memory", "min": mebibytes}, {"name": "amount.worker.gpu", "min": 0}]
        template["steps"][0]["hostRequirements"] = {"attributes": attributes, "amounts": amounts}
        (tmp_path / "job.yaml").write_text(yaml.safe_dump(template))
        assert read_template(tmp_path / "job.yaml")[0].needs == needs


def test_frames_may_be_a_list(tmp_path: Path) -> None:
    """A list of numbers and expressions, of which OpenJD's library returns some as texts."""
    (tmp_path / "box.yaml").write_text("shapes: [{type: sphere}]\n")
    template, _ = template_of([str(tmp_path / "box.yaml"), "-o", str(tmp_path / "a.#.png"), "--frames=5"], tmp_path)
    space = template["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0]
    for given, frames in ((["1", "{{Param.Frames}}", 3], "1,3,5"), (["1", "{{Param.Scene}}"], None)):
        space["range"] = given
        (tmp_path / "job.yaml").write_text(yaml.safe_dump(template))
        if frames is not None:
            assert read_template(tmp_path / "job.yaml")[0].frames == frames
        else:
            with pytest.raises(CommandError, match="not a valid job template"):
                read_template(tmp_path / "job.yaml")


def test_a_scene_file_is_no_template(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not is_template(CORNELL)
    assert not is_template(tmp_path)
    (tmp_path / "broken.yaml").write_text("specificationVersion: [")
    assert not is_template(tmp_path / "broken.yaml")
    done = rayfarm("submit", CORNELL, "--param", "Frames=1", "--server", "http://127.0.0.1:9")
    assert done.returncode == 1 and "--param needs a job template" in done.stderr
    (tmp_path / "job.yaml").write_text("specificationVersion: jobtemplate-2023-09\n")
    for words, said in ((["--spp=3"], "--spp is not taken"), (["--param", "x"], "--param is 'x'")):
        done = rayfarm("submit", tmp_path / "job.yaml", *words, COLUMNS="200")
        assert done.returncode == 1 and said in done.stderr
    monkeypatch.setitem(sys.modules, "openjd.model", None)
    with pytest.raises(CommandError, match=r"rayfarm\[openjd\]"):
        read_template(tmp_path / "job.yaml")
