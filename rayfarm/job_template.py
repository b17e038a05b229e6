"""Job templates of Open Job Description (OpenJD, specification 2023-09) whose tasks are calls of `rayfarm render`.

`template_of` makes one from the command line of `rayfarm render`; `read_template` turns one back into the options of such a
call, for a farm (service/intake/job_template.py). https://github.com/OpenJobDescription/openjd-specifications/wiki/2023-09-Template-Schemas
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import click
import typer
import yaml

from rayfarm.errors import CommandError
from renderer.errors import SettingsError
from renderer.frames import equal_steps, parse_frames
from service.intake.job_template import CHUNKING, TemplateCall, has_model, read_calls
from service.intake.render_words import LOCAL_ONLY

__all__ = [
    "RenderCall",
    "is_template",
    "parsed_options",
    "range_expression",
    "read_template",
    "render_command",
    "scene_of",
    "template_of",
]

VERSION = "jobtemplate-2023-09"
SUFFIXES = (".yaml", ".yml", ".json")
MAX_TEMPLATE = 1 << 20  # bytes
MAX_TEXT = 1024  # characters of a parameter's default
MISSING_MODEL = 'Job templates are read by the package openjd-model: pip install "rayfarm[openjd]"'

# Options whose value is a path: (the parameter's name, its kind, its data flow).
PATHS = {
    "scene": ("Scene", "", "IN"),
    "output": ("Output", "FILE", "OUT"),
    "env": ("Environment", "FILE", "IN"),
    "root": ("Root", "DIRECTORY", "IN"),
}


@dataclass(frozen=True)
class RenderCall:
    """A call of `rayfarm render` with all frames of a template's tasks.

    options: by the names of the command's parameters, those given only; without frames. frames: as --frames has them; None for
    a still. needs: what its workers must have, as `rayfarm submit --need`. step: the step's name. after: the names of the steps
    on which it depends.
    """

    options: dict[str, Any]
    frames: str | None = None
    needs: list[str] = field(default_factory=list)
    name: str = ""
    step: str = ""
    after: tuple[str, ...] = ()


def scene_of(words: Sequence[str]) -> Path:
    """Returns the scene of a command line after `rayfarm render`. Raises CommandError."""
    return Path(_parsed(words)[1]["scene"])


def template_of(words: Sequence[str], folder: Path, chunk: int = 1, name: str | None = None) -> tuple[dict[str, Any], list[str]]:
    """Returns the template of a call of `rayfarm render`, and the names of its parameters that have no default.

    words: the command line after `rayfarm render`. folder: the template's. A path outside of it cannot be a default by the
    specification. chunk: frames of a task; more than one needs the extension TASK_CHUNKING. Raises CommandError.
    """
    command, given = _parsed(words)
    if "frame" in given and "frames" in given:
        raise CommandError("--frame and --frames were both given; --frames 7,9-12 names any of them")
    frames = parse_frames(given["frames"]) if "frames" in given else None
    scene = Path(given["scene"])
    given.setdefault("output", Path(f"{scene.resolve().stem}{'' if frames is None else '.####'}.png"))
    _check_output(Path(given["output"]), frames)
    parameters: list[dict[str, Any]] = []
    arguments = ["render"]
    for each in command.params:
        if each.name is None or each.name not in given or each.name in ("frames", "overwrite"):
            continue
        value = given[each.name]
        if each.name in PATHS and (each.name != "env" or Path(str(value)).expanduser().is_file()):
            value = f"{{{{Param.{PATHS[each.name][0]}}}}}"
            parameters.append(_path_parameter(each.name, Path(given[each.name]).expanduser(), folder))
        elif "{{" in str(value):
            raise CommandError(f"{value!r} holds {{{{, which begins an expression in a job template")
        arguments += _words_of(each, value)
    step: dict[str, Any] = {"name": "Render"}
    if frames is not None:
        expression = range_expression(frames)
        parameters.append({"name": "Frames", "type": "STRING", "default": expression, "description": "Such as 1-10:2"})
        task: dict[str, Any] = {"name": "Frame", "type": "INT", "range": "{{Param.Frames}}"}
        if chunk > 1:
            task |= {"type": "CHUNK[INT]", "chunks": {"defaultTaskCount": chunk, "rangeConstraint": "NONCONTIGUOUS"}}
        step["parameterSpace"] = {"taskParameterDefinitions": [task]}
        arguments += ["--frames", "{{Task.Param.Frame}}"]
    elif chunk > 1:
        raise CommandError("--chunk goes with --frames: a still is one task")
    if given.get("overwrite"):
        arguments.append("--overwrite")
    step["script"] = {"actions": {"onRun": {"command": "rayfarm", "args": arguments}}}
    template: dict[str, Any] = {"specificationVersion": VERSION}
    if chunk > 1:
        template["extensions"] = [CHUNKING]
    template |= {"name": name or scene.name, "parameterDefinitions": parameters, "steps": [step]}
    return template, [each["name"] for each in parameters if "default" not in each]


def range_expression(frames: Iterable[float]) -> str:
    """Returns frame numbers as OpenJD's range expression: 1-10:2 for every second one. Raises CommandError for half frames."""
    numbers = sorted(frames)
    if half := [number for number in numbers if number != int(number)]:
        raise CommandError(f"--frames names {half[0]:g}; the tasks of a job template are whole numbers")
    parts = []
    for first, last, step in equal_steps(numbers):
        text = f"{first:g}" if first < 1e5 else f"{first:.0f}"
        if last != first:
            text += f"-{last:.0f}" + (f":{step:.0f}" if step != 1 else "")
        parts.append(text)
    if len(text := ",".join(parts)) > MAX_TEXT:
        raise CommandError(f"--frames has {len(parts)} ranges, which are too long for a job template; split them into several")
    return text


def is_template(path: Path) -> bool:
    """Returns True if a file is a template of OpenJD, and not a scene: it says its specificationVersion."""
    if path.suffix.lower() not in SUFFIXES or not path.is_file() or path.stat().st_size > MAX_TEMPLATE:
        return False
    return b"specificationVersion" in (data := path.read_bytes()) and isinstance(_document(data), dict)


def read_template(path: Path, values: Mapping[str, str] | None = None) -> list[RenderCall]:
    """Returns the calls of `rayfarm render` that the steps of a template stand for, each after those on which it depends.

    values: of its job parameters, by name. Raises CommandError that names the part of the template that a farm has no counterpart
    for.
    """
    if not has_model():
        raise CommandError(MISSING_MODEL)
    try:
        calls = read_calls(_document(path.read_bytes()), values or {}, path.resolve().parent, Path.cwd())
    except SettingsError as error:
        raise CommandError(f"{path.name}: {error}") from None
    return [_render_call(path, each) for each in calls]


def _render_call(path: Path, call: TemplateCall) -> RenderCall:
    options = _parsed(call.words)[1]
    for name in LOCAL_ONLY:
        if {name.replace("-", "_"), f"as_{name}"} & options.keys():
            raise CommandError(f"{path.name}: --{name} is not supported by a farm")
    frames = call.frames if call.frames is not None else options.pop("frames", None)
    return RenderCall(options, frames, call.needs, call.name, call.step, call.after)


def render_command() -> click.Command:
    """Returns the program's command `render`."""
    from rayfarm.commands import render

    app = typer.Typer()
    render.register(app)
    command: Any = typer.main.get_command(app)
    return command


def parsed_options(words: Sequence[str]) -> dict[str, Any]:
    """Returns the options that a command line after `rayfarm render SCENE` gives, by parameter name. Raises CommandError."""
    return _parsed(["scene", *words])[1]


def _parsed(words: Sequence[str]) -> tuple[click.Command, dict[str, Any]]:
    """Returns the command `render`, and the options that a command line gives it. Raises CommandError."""
    command = render_command()
    try:
        context = command.make_context("rayfarm render", list(words))
    except Exception as error:  # click's own, which Typer brings along
        if not hasattr(error, "format_message"):
            raise
        raise CommandError(f"`rayfarm render` does not take this: {error.format_message()}") from None
    sources = {name: context.get_parameter_source(name) for name in context.params}
    return command, {name: value for name, value in context.params.items() if getattr(sources[name], "name", "") == "COMMANDLINE"}


def _check_output(output: Path, frames: list[float] | None) -> None:
    from service.watching.movie import is_movie

    if is_movie(output):
        raise CommandError(f"-o is {output.name}; the tasks of a job template write pictures, not one film: -o out.####.exr")
    if frames is not None and "#" not in output.name:
        raise CommandError(f"-o names one file for all tasks. Write #### for their numbers: -o {output.stem}.####{output.suffix}")


def _path_parameter(option: str, path: Path, folder: Path) -> dict[str, Any]:
    name, kind, flow = PATHS[option]
    kind = kind or ("DIRECTORY" if path.is_dir() else "FILE")
    found: dict[str, Any] = {"name": name, "type": "PATH", "objectType": kind, "dataFlow": flow}
    full = Path(os.path.normpath(path.absolute()))
    if full.is_relative_to(folder.absolute()):
        found["default"] = full.relative_to(folder.absolute()).as_posix()
    return found


def _words_of(parameter: click.Parameter, value: Any) -> list[str]:
    """Returns the words of a command line that give an option its value."""
    if not parameter.opts or not parameter.opts[0].startswith("-"):
        return [str(value)]
    if isinstance(value, bool):
        return [parameter.opts[0] if value else parameter.secondary_opts[0]]
    return [parameter.opts[0], str(value)]


def _document(data: bytes) -> Any:
    """Returns the contents of a YAML or JSON file; None if it is neither."""
    try:
        return yaml.safe_load(data)
    except (yaml.YAMLError, UnicodeError, RecursionError, ValueError):
        return None
