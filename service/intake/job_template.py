"""Reading job templates of Open Job Description (OpenJD, specification 2023-09) whose tasks are calls of `rayfarm render`.

The REST API and `rayfarm submit` share it. https://github.com/OpenJobDescription/openjd-specifications/wiki
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import islice
from math import isfinite
from pathlib import Path, PurePath
from typing import Any

from protocol.terms import TAG
from renderer.errors import SettingsError
from renderer.frames import MAX_FRAME, MAX_FRAMES, frames_text
from renderer.sentences import Sentence

__all__ = ["CHUNKING", "TemplateCall", "has_model", "read_call", "read_calls"]

CHUNKING = "TASK_CHUNKING"
GB_PER_MIB = (1 << 20) / 1e9
MEMORY = "amount.worker.memory"  # MiB
TAGS = "attr.rayfarm.tags"  # of workers
ATTRIBUTES = {"attr.worker.os.family": "linux", "attr.worker.cpu.arch": "x86_64"}  # taken as met by every worker
FRAME_OPTIONS = ("--frames", "--frame")
MAX_MESSAGE = 600  # characters
MAX_NAME = 200  # characters, of a job

# Of a template. OpenJD's library takes up to a minute for one of a megabyte.
MAX_BYTES = 1 << 15  # of text, also in the expanded command line
MAX_VALUES = 4096
MAX_DEPTH = 64


@dataclass(frozen=True)
class TemplateCall:
    """The call of `rayfarm render` that the tasks of a template's step make.

    words: its command line after `rayfarm render`, without the option whose value is the task's frame. frames: of all tasks, as
    --frames has them; None if the tasks have no parameter. needs: what workers must have, as the API's `needs`. name: the job's,
    with that of the step if there are several. step: its name. after: the names of the steps on which it depends.
    """

    words: list[str]
    frames: str | None = None
    needs: list[str] = field(default_factory=list)
    name: str = ""
    step: str = ""
    after: tuple[str, ...] = ()


def has_model() -> bool:
    """Returns True if the package openjd-model is installed, without which no template can be read."""
    from importlib.util import find_spec

    return find_spec("openjd") is not None and find_spec("openjd.model") is not None


def read_call(
    document: Any,
    values: Mapping[str, Any],
    folder: Path,
    current: Path,
    free_paths: bool = False,
    step: str | None = None,
) -> TemplateCall:
    """Returns the call that a step of a template stands for. Reads no file.

    document: contents of the template. values: of its job parameters, by name. folder, current: the template's folder and the
    present one, by which relative paths are completed. free_paths: path parameters without default and value are not an error.
    step: its name; None if the template has one step. Raises SettingsError that names the part of the template for which a farm
    has no counterpart.
    """
    job, parameters = _expanded(document, values, folder, current, free_paths)
    names = [str(each.name) for each in job.steps]
    if step is None and len(names) > 1:
        raise _fault(
            Sentence("template-step-unnamed", "it has the steps {names}; a job is one of them: name it as step", names=names)
        )
    if step is not None and step not in names:
        raise _fault(Sentence("template-step-unknown", "it has no step {step}; it has {names}", step=step[:200], names=names))
    return _call_of(job, 0 if step is None else names.index(step), parameters)


def read_calls(document: Any, values: Mapping[str, Any], folder: Path, current: Path) -> list[TemplateCall]:
    """Returns the calls of all steps of a template, each after those on which it depends; arguments and errors as `read_call`."""
    job, parameters = _expanded(document, values, folder, current, False)
    waiting = [_call_of(job, number, parameters) for number in range(len(job.steps))]
    found: list[TemplateCall] = []
    while waiting:  # openjd-model has refused circles and unknown names
        ready = next(each for each in waiting if {*each.after} <= {done.step for done in found})
        waiting.remove(ready)
        found.append(ready)
    return found


def _expanded(
    document: Any, values: Mapping[str, Any], folder: Path, current: Path, free_paths: bool
) -> tuple[Any, Mapping[str, Any]]:
    """Returns the job of a template with its parameters' values, and these."""
    from openjd.model import create_job, decode_job_template, preprocess_job_parameters
    from openjd.model._errors import DecodeValidationError

    if not isinstance(document, dict):
        raise _fault(Sentence("template-not-object", "this is not a job template"))
    _check_size(document)
    given = dict(values)
    try:
        template = decode_job_template(template=document, supported_extensions=[CHUNKING])
        if free_paths:
            for each in template.parameterDefinitions or ():
                if each.type.value == "PATH" and each.default is None:
                    given.setdefault(str(each.name), str(each.name))
        parameters = preprocess_job_parameters(
            job_template=template, job_parameter_values=given, job_template_dir=folder, current_working_dir=current
        )
        job = create_job(job_template=template, job_parameter_values=parameters)
    except (DecodeValidationError, ValueError, NotImplementedError, OverflowError) as error:
        raise _invalid(error) from None
    return job, parameters


def _call_of(job: Any, number: int, parameters: Mapping[str, Any]) -> TemplateCall:
    step = job.steps[number]
    _check_parts(job, step)
    symbols = _symbols(parameters)
    definitions: Mapping[str, Any] = step.parameterSpace.taskParameterDefinitions if step.parameterSpace else {}
    names = list(definitions)
    if len(names) > 1:
        raise _fault(
            Sentence(
                "template-parameters-many",
                "the task parameters {names} are not supported; one may be the frame",
                names=[str(each) for each in names],
            )
        )
    # The words of two tasks differ in the frame and in nothing else.
    one, other = (_words(step.script.actions.onRun, symbols, names, frame) for frame in ("1", "2"))
    words = _arguments(one)
    frames = None
    if names:
        words = _without_frame(words, _arguments(other), str(names[0]))
        frames = frames_text(_numbers(definitions[names[0]], str(names[0])))
    name = str(job.name) if len(job.steps) == 1 else f"{job.name}: {step.name}"
    after = tuple(str(each.dependsOn) for each in step.dependencies or ())
    return TemplateCall(words, frames, _needs(step.hostRequirements), name[:MAX_NAME], str(step.name), after)


def _fault(sentence: str) -> SettingsError:
    return SettingsError(sentence, field="template")


def _invalid(error: Exception) -> SettingsError:
    return _fault(Sentence("template-invalid", "this is not a valid job template: {error}", error=_one_line(error)))


def _too_large() -> SettingsError:
    return _fault(
        Sentence(
            "template-too-large",
            "it is too large: it has more than {size} bytes of text, {values} values or {depth} levels",
            size=MAX_BYTES,
            values=MAX_VALUES,
            depth=MAX_DEPTH,
        )
    )


def _check_size(document: Any) -> None:
    """Raises SettingsError for a template that is too large, or has a text or number that JSON does not have."""
    size = count = 0
    rest = [(document, 1)]
    while rest:
        value, depth = rest.pop()
        count += 1
        if isinstance(value, str):
            try:
                size += len(value.encode())
            except UnicodeEncodeError as error:
                raise _invalid(error) from None
        elif isinstance(value, float) and not isfinite(value):
            raise _fault(
                Sentence("template-number-not-finite", "it has the number {number}, which JSON does not have", number=str(value))
            )
        parts = [*value, *value.values()] if isinstance(value, dict) else value if isinstance(value, list) else []
        if size > MAX_BYTES or count + len(rest) + len(parts) > MAX_VALUES or depth > MAX_DEPTH:
            raise _too_large()
        rest += [(part, depth + 1) for part in parts]


def _unsupported(part: str) -> SettingsError:
    return _fault(
        Sentence(
            "template-part-unsupported",
            "{part} is not supported. A farm takes templates whose steps call `rayfarm render`",
            part=part,
        )
    )


def _one_line(error: Exception) -> str:
    return "; ".join(line.strip() for line in str(error).splitlines() if line.strip())[:MAX_MESSAGE]


def _check_parts(job: Any, step: Any) -> None:
    """Raises SettingsError for the first part of a job's step that a farm's shot cannot express."""
    for part, value in (
        ("jobEnvironments", job.jobEnvironments),
        ("stepEnvironments", step.stepEnvironments),
        ("embeddedFiles", step.script.embeddedFiles),
        ("timeout", step.script.actions.onRun.timeout),
    ):
        if value:
            raise _unsupported(part)


def _symbols(parameters: Mapping[str, Any]) -> Any:
    from openjd.model import SymbolTable

    symbols = SymbolTable()
    for name, each in parameters.items():
        symbols[f"Param.{name}"] = symbols[f"RawParam.{name}"] = each.value
    return symbols


def _words(action: Any, symbols: Any, names: list[str], frame: str) -> list[str]:
    """Returns the words that a task runs, with a frame number as the value of its task parameter."""
    from openjd.model import FormatStringError, SymbolTable

    table = SymbolTable(source=symbols)
    for name in names:
        table[f"Task.Param.{name}"] = table[f"Task.RawParam.{name}"] = frame
    try:
        words = [str(each.resolve(symtab=table)) for each in (action.command, *(action.args or ()))]
    except FormatStringError as error:
        raise _fault(
            Sentence(
                "template-expression-unsupported", "{error}: only job and task parameters are supported", error=_one_line(error)
            )
        ) from None
    if sum(map(len, words)) > MAX_BYTES:
        raise _too_large()
    return words


def _arguments(words: list[str]) -> list[str]:
    """Returns the words after `rayfarm render` (or `python -m rayfarm render`)."""
    program, rest = PurePath(words[0]).name, words[1:]
    if program.startswith("python") and rest[:2] == ["-m", "rayfarm"]:
        program, rest = "rayfarm", rest[2:]
    if program.removesuffix(".exe") != "rayfarm" or rest[:1] != ["render"]:
        raise _fault(
            Sentence(
                "template-command-unsupported",
                "the command `{command}` is not supported; a farm runs `rayfarm render` alone",
                command=" ".join(words[:3])[:200],
            )
        )
    return rest[1:]


def _without_frame(one: list[str], other: list[str], name: str) -> list[str]:
    """Returns the words of two tasks without the option that has the frame. Raises SettingsError if they differ elsewhere."""
    kept: list[str] = []
    found = False
    for word, second in zip(one, other, strict=True):
        if word == second:
            kept.append(word)
            continue
        option, equals, value = word.partition("=") if word.startswith("--") else (kept.pop() if kept else word, "=", word)
        if option not in FRAME_OPTIONS or not equals or value != "1" or found:
            raise _frame_elsewhere(name, option if option not in FRAME_OPTIONS else word)
        found = True
    if not found:
        raise _frame_elsewhere(name, "--frames")
    for word in kept:
        if word.partition("=")[0] in FRAME_OPTIONS:
            raise _fault(
                Sentence("template-frame-twice", "{option} is given beside the task's frame", option=word.partition("=")[0])
            )
    return kept


def _frame_elsewhere(name: str, option: str) -> SettingsError:
    return _fault(
        Sentence(
            "template-frame-elsewhere",
            "the task parameter {name} is in {option}; it must be the value of --frames alone",
            name=name,
            option=option[:60],
        )
    )


def _numbers(definition: Any, name: str) -> list[float]:
    """Returns the frames of all tasks, from the only task parameter of a step. Stops at the most that a shot may have."""
    if definition.type.value not in ("INT", "CHUNK[INT]"):
        raise _fault(
            Sentence(
                "template-parameter-type",
                "the task parameter {name} is of the type {kind}; frames are INT",
                name=name,
                kind=definition.type.value,
            )
        )
    numbers: Iterable[Any] = definition.range
    try:
        found = [int(number) for number in islice(numbers, MAX_FRAMES + 1)]  # some of a list stay texts
    except ValueError as error:
        raise _invalid(error) from None
    if len(found) > MAX_FRAMES:
        raise _fault(
            Sentence("template-frames-many", "it has more than {most} frames. Split them into several jobs", most=MAX_FRAMES)
        )
    if min(found) < 0:
        raise _fault(
            Sentence(
                "template-frame-negative", "it has the frame {frame}; a farm's frames begin at 0", frame=str(min(found))[:20]
            )
        )
    if max(found) > MAX_FRAME:
        raise _fault(
            Sentence(
                "frame-invalid",
                "{frame} is not a frame; give a number from 0 to {most}, in steps of a half",
                frame=str(max(found))[:20],
                most=MAX_FRAME,
            )
        )
    return [float(number) for number in found]


def _needs(requirements: Any) -> list[str]:
    """Returns what a farm's workers must have, from a step's hostRequirements."""
    if requirements is None:
        return []
    needs = []
    for each in requirements.attributes or ():
        needs += _needed_tags(str(each.name), each)
    for each in requirements.amounts or ():
        if each.max is not None or (each.min and str(each.name).lower() != MEMORY):
            raise _unsupported_requirement(str(each.name))
        if each.min:
            gigabytes = f"{max(float(each.min) * GB_PER_MIB - 0.0005, 0.0):.3f}"  # rounded down
            needs.append(f"memory_gb={gigabytes.rstrip('0').rstrip('.')}")
    return list(dict.fromkeys(needs))


def _needed_tags(name: str, requirement: Any) -> list[str]:
    """Returns the tags that workers must have by a required attribute; none for one that is taken as met."""
    every, one = ([str(value) for value in values or ()] for values in (requirement.allOf, requirement.anyOf))
    if (common := ATTRIBUTES.get(name.lower())) is not None:
        if all(value.lower() == common for value in every) and (not one or common in map(str.lower, one)):
            return []
        raise _unsupported_requirement(f"{name}: {', '.join(every or one)}")
    if name.lower() == TAGS and len(one) <= 1 and all(TAG.fullmatch(value) for value in (*every, *one)):
        return [*every, *one]
    raise _unsupported_requirement(name)


def _unsupported_requirement(name: str) -> SettingsError:
    return _fault(
        Sentence(
            "template-requirement-unsupported",
            "the requirement {name} is not supported; a minimum of {memory} is, and worker tags by allOf of {tags}",
            name=name[:200],
            memory=MEMORY,
            tags=TAGS,
        )
    )
