"""Job templates of Open Job Description (OpenJD, specification 2023-09) whose tasks are calls of `rayfarm render`.

`template_of` makes one from the command line of `rayfarm render`; `read_template` turns one back into the options of such a
call, for a farm. https://github.com/OpenJobDescription/openjd-specifications/wiki/2023-09-Template-Schemas
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
from renderer.frames import MAX_FRAMES, equal_steps, frames_text, parse_frames

__all__ = ["RenderCall", "is_template", "range_expression", "read_template", "scene_of", "template_of"]

VERSION = "jobtemplate-2023-09"
CHUNKING = "TASK_CHUNKING"
SUFFIXES = (".yaml", ".yml", ".json")
MAX_TEMPLATE = 1 << 20  # bytes
MAX_TEXT = 1024  # characters of a parameter's default
MIB_PER_GB = 1e9 / (1 << 20)
MEMORY = "amount.worker.memory"  # MiB
MISSING_MODEL = 'Job templates are read by the package openjd-model: pip install "rayfarm[openjd]"'

# What only this machine can do, or writes besides the picture: a farm has no such options.
LOCAL_ONLY = (
    "exposure",
    "tonemap",
    "ocio",
    "gain_map",
    "stats",
    "tile",
    "first",
    "pixel",
    "sample",
    "as_json",
    "threads",
    "gpu",
    "no_bvh",
    "overwrite",
)
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
    a still. needs: what its workers must have, as `rayfarm submit --need`.
    """

    options: dict[str, Any]
    frames: str | None = None
    needs: list[str] = field(default_factory=list)
    name: str = ""


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


def read_template(path: Path, values: Mapping[str, str] | None = None) -> RenderCall:
    """Returns the call of `rayfarm render` that a template stands for. values: of its job parameters, by name.

    Raises CommandError that names the part of the template that a farm has no counterpart for.
    """
    try:
        from openjd.model import create_job, decode_job_template, preprocess_job_parameters
        from openjd.model._errors import DecodeValidationError
    except ModuleNotFoundError:
        raise CommandError(MISSING_MODEL) from None
    document = _document(path.read_bytes())
    if not isinstance(document, dict):
        raise CommandError(f"{path.name} is no job template")
    try:
        template = decode_job_template(template=document, supported_extensions=[CHUNKING])
        parameters = preprocess_job_parameters(
            job_template=template,
            job_parameter_values=dict(values or {}),
            job_template_dir=path.resolve().parent,
            current_working_dir=Path.cwd(),
        )
        job = create_job(job_template=template, job_parameter_values=parameters)
    except (DecodeValidationError, ValueError, NotImplementedError) as error:
        raise CommandError(f"{path.name} is no valid job template: {_one_line(error)}") from None
    part = _unsupported_part(job)
    if part is not None:
        raise CommandError(f"{path.name}: {part}. A farm takes templates of one step that calls `rayfarm render`")
    step = job.steps[0]
    symbols = _symbols(parameters)
    names = list(step.parameterSpace.taskParameterDefinitions) if step.parameterSpace else []
    if len(names) > 1:
        raise CommandError(f"{path.name}: the task parameters {', '.join(names)} are not supported; one may be the frame")
    # The words of two tasks differ in the frame and in nothing else.
    ones, others = (_words(path, step.script.actions.onRun, symbols, names, value) for value in ("1", "2"))
    one, other = _call(path, ones), _call(path, others)
    frames = None
    if names:
        varying = {key for key in one.keys() | other.keys() if one.get(key) != other.get(key)}
        taken = {str(call.get("frames", call.get("frame"))).removesuffix(".0") for call in (one, other)}
        if not varying <= {"frame", "frames"} or taken != {"1", "2"}:
            wrong = f"--{min(varying - {'frame', 'frames'} or {'frames'}).replace('_', '-')}"
            raise CommandError(
                f"{path.name}: the task parameter {names[0]} is in {wrong}; it must be the value of --frames alone"
            )
        frames = frames_text(_numbers(path, step.parameterSpace, names[0]))
    elif "frames" in one:
        frames = one["frames"]
    options = {key: value for key, value in one.items() if key != "frames" and not (names and key == "frame")}
    return RenderCall(options, frames, _needs(path, step.hostRequirements), str(job.name))


def _parsed(words: Sequence[str]) -> tuple[click.Command, dict[str, Any]]:
    """Returns the command `render`, and the options that a command line gives it. Raises CommandError."""
    from rayfarm.commands import render

    app = typer.Typer()
    render.register(app)
    command: Any = typer.main.get_command(app)
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


def _one_line(error: Exception) -> str:
    return "; ".join(line.strip() for line in str(error).splitlines() if line.strip())[:600]


def _unsupported_part(job: Any) -> str | None:
    """Returns the first part of a job that a farm's shot cannot express; None if there is none."""
    if len(job.steps) != 1:
        return f"{len(job.steps)} steps are not supported"
    step = job.steps[0]
    for part, value in (
        ("jobEnvironments", job.jobEnvironments),
        ("dependencies", step.dependencies),
        ("stepEnvironments", step.stepEnvironments),
        ("embeddedFiles", step.script.embeddedFiles),
        ("timeout", step.script.actions.onRun.timeout),
    ):
        if value:
            return f"{part} is not supported"
    return None


def _symbols(parameters: Mapping[str, Any]) -> Any:
    from openjd.model import SymbolTable

    symbols = SymbolTable()
    for name, each in parameters.items():
        symbols[f"Param.{name}"] = symbols[f"RawParam.{name}"] = each.value
    return symbols


def _words(path: Path, action: Any, symbols: Any, names: list[str], frame: str) -> list[str]:
    """Returns the words that a task runs, with a frame number as the value of its task parameter."""
    from openjd.model import FormatStringError, SymbolTable

    table = SymbolTable(source=symbols)
    for name in names:
        table[f"Task.Param.{name}"] = table[f"Task.RawParam.{name}"] = frame
    try:
        return [str(each.resolve(symtab=table)) for each in (action.command, *(action.args or ()))]
    except FormatStringError as error:
        raise CommandError(f"{path.name}: {_one_line(error)}: only job and task parameters are supported") from None


def _call(path: Path, words: list[str]) -> dict[str, Any]:
    """Returns the options of a task's call of `rayfarm render`."""
    program, rest = Path(words[0]).name, words[1:]
    if program.startswith("python") and rest[:2] == ["-m", "rayfarm"]:
        program, rest = "rayfarm", rest[2:]
    if program.removesuffix(".exe") != "rayfarm" or rest[:1] != ["render"]:
        shown = " ".join(words[:3])
        raise CommandError(f"{path.name}: the command `{shown}` is not supported; a farm runs `rayfarm render` alone")
    given = _parsed(rest[1:])[1]
    for name in LOCAL_ONLY:
        if name in given and name != "overwrite":
            raise CommandError(f"{path.name}: --{name.replace('as_', '').replace('_', '-')} is not supported by a farm")
    return given


def _numbers(path: Path, space: Any, name: str) -> list[float]:
    """Returns the frames of all tasks."""
    from openjd.model import IntRangeExpr, StepParameterSpaceIterator

    found: list[float] = []
    for task in StepParameterSpaceIterator(space=space):
        value = task[name]
        if value.type.value not in ("INT", "CHUNK[INT]"):
            raise CommandError(f"{path.name}: the task parameter {name} is of the type {value.type.value}; frames are INT")
        found += map(float, IntRangeExpr.from_str(str(value.value)))
        if len(found) > MAX_FRAMES:
            raise CommandError(f"{path.name} has more than {MAX_FRAMES} frames. Split them into several jobs")
    if min(found) < 0:
        raise CommandError(f"{path.name} has the frame {min(found):g}; a farm's frames begin at 0")
    return found


def _needs(path: Path, requirements: Any) -> list[str]:
    """Returns what a farm's workers must have, from a step's hostRequirements."""
    if requirements is None:
        return []
    if requirements.attributes:
        raise CommandError(f"{path.name}: the requirement {requirements.attributes[0].name} is not supported")
    needs = []
    for each in requirements.amounts or ():
        if str(each.name) != MEMORY or each.min is None or each.max is not None:
            raise CommandError(f"{path.name}: the requirement {each.name} is not supported; a minimum of {MEMORY} is")
        needs.append(f"memory_gb={float(each.min) / MIB_PER_GB:.4g}")
    return needs
