"""Translation of a command line of `rayfarm render` to the fields of a request for a job, for job templates sent by REST.

The names and types of options come from the declarations of settings, as those of the command do (rayfarm/declared_options.py).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from renderer.cameras import camera_number
from renderer.errors import SettingsError
from renderer.presets import PRESETS
from renderer.sentences import Sentence
from renderer.setting_declaration import DeclaredSetting
from renderer.settings import ENVIRONMENT, OPTIONAL, SETTINGS, VIEW
from renderer.work import WORK

__all__ = ["FLAGS", "LOCAL_ONLY", "VALUES", "request_fields"]

# Options about one machine, or about what it writes besides the picture: a farm has no counterpart.
LOCAL_ONLY = (
    "exposure",
    "tonemap",
    "ocio",
    "gain-map",
    "stats",
    "tile",
    "first",
    "pixel",
    "sample",
    "json",
    "threads",
    "gpu",
    "no-bvh",
)
FLAGS = ("overwrite", "denoise", "strict", "floor", "no-floor", *LOCAL_ONLY)
UNUSED = ("output", "root", "aov")  # of files, as --overwrite: the scene is uploaded already, and pictures are fetched
SHORT = {"o": "output"}
TEXTS = ("size", "camera", "distortion", "up-axis", "env", "variant", "clip", "frames", "frame", "fps", "turntable", *UNUSED)
SKY = "sky:"

_PICTURE = {each.option: (name, each) for name, each in SETTINGS.items() if name in OPTIONAL}
_LIMITS = {WORK[name].option: (name, WORK[name]) for name in ("spp", "noise", "seconds")}
_LIGHT = {each.option: (name, each) for name, each in ENVIRONMENT.items() if name != "color"}
_VIEW = {each.option: (name, each) for name, each in VIEW.items()}
_DECLARED: Mapping[str, tuple[str, DeclaredSetting]] = {**_PICTURE, **_LIMITS, **_LIGHT, **_VIEW}
VALUES = frozenset((*TEXTS, *_DECLARED))  # options with a value, those that are not flags


def request_fields(words: Sequence[str], cameras: Sequence[Mapping[str, Any]] | None, image: str | None = None) -> dict[str, Any]:
    """Returns the fields of POST /api/jobs that ask for the picture of a command line, without `scene`.

    words: what follows `rayfarm render`. cameras: of the scene; None while they are not known. image: id of the uploaded
    environment that replaces the file of --env. Raises SettingsError.
    """
    given = dict(_options(words))
    values = {option: _typed(option, given[option]) for option in given if option in _DECLARED}
    found: dict[str, Any] = {}
    for table in (_PICTURE, _LIMITS):
        found |= {name: values[option] for option, (name, _) in table.items() if option in values}
    if "size" in given:
        found["width"], found["height"] = _size(given["size"])
    light = {name: values[option] for option, (name, _) in _LIGHT.items() if option in values}
    if light := {**_light(given.get("env"), image), **light}:
        found["environment"] = light
    view = {name: values[option] for option, (name, _) in _VIEW.items() if option in values}
    if "distortion" in given:
        view["distortion"] = _distortion(given["distortion"])
    if view:
        found["view"] = _view(view, cameras, given.get("camera"))
    elif "camera" in given:
        found["camera"] = given["camera"]
    for option, name in (("up-axis", "up"), ("variant", "variant"), ("clip", "clip"), ("frames", "frames")):
        if option in given:
            found[name] = given[option]
    for option in ("frame", "fps", "turntable"):
        if option in given:
            found[option] = _number(option, given[option])
    for option, (name, value) in {
        "denoise": ("denoise", True),
        "strict": ("strict", True),
        "floor": ("floor", "on"),
        "no-floor": ("floor", "off"),
    }.items():
        if option in given:
            found[name] = value
    return found


def _options(words: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yields (option without dashes, value) of a command line; an option that is given twice comes twice."""
    rest = list(words)
    scenes = 0
    while rest:
        word = rest.pop(0)
        if not word.startswith("-") or word == "-":
            scenes += 1
            continue
        option, equals, value = word.removeprefix("--").partition("=")
        if not word.startswith("--"):
            option, equals, value = SHORT.get(word[1:2], ""), word[2:], word[2:]
        if option in LOCAL_ONLY:
            raise _fault(Sentence("template-option-local", "--{option} is not supported by a farm", option=option))
        if option not in VALUES and option not in FLAGS:
            raise _fault(Sentence("template-option-unknown", "`rayfarm render` does not take {word}", word=repr(word[:60])))
        if option in FLAGS and equals:
            raise _fault(Sentence("template-option-flag", "--{option} takes no value", option=option))
        if option not in FLAGS and not equals:
            if not rest:
                raise _fault(Sentence("template-option-empty", "--{option} has no value", option=option))
            value = rest.pop(0)
        yield option, value
    if scenes != 1:
        raise _fault(Sentence("template-scene-count", "`rayfarm render` takes one scene, not {count}", count=scenes))


def _fault(sentence: str) -> SettingsError:
    return SettingsError(sentence, field="template")


def _invalid(option: str, value: str, wanted: str) -> SettingsError:
    return _fault(
        Sentence(
            "template-option-invalid",
            "--{option} is {value}; it takes {wanted}",
            option=option,
            value=repr(value[:60]),
            wanted=wanted,
        )
    )


def _number(option: str, text: str, kind: type = float) -> Any:
    try:
        return kind(text)
    except ValueError:
        raise _invalid(option, text, Sentence("schema-number", "a number")) from None


def _numbers(option: str, text: str, count: int) -> list[float]:
    parts = text.split(",")
    if len(parts) != count:
        raise _invalid(option, text, Sentence("template-takes-numbers", "{count} numbers with commas between", count=count))
    return [_number(option, part) for part in parts]


def _typed(option: str, text: str) -> Any:
    """Returns an option's value with the type of its setting. Ranges and names are checked by the request's model."""
    each = _DECLARED[option][1]
    if each.kind is tuple:
        return _numbers(option, text, 3)
    return _number(option, text, each.kind) if each.kind in (int, float) else text


def _size(text: str) -> tuple[int, int]:
    width, x, height = text.lower().partition("x")
    if not x or not (width.isascii() and width.isdigit() and height.isascii() and height.isdigit()) or len(text) > 20:
        raise _invalid("size", text, Sentence("template-takes-size", "width x height in pixels, as 1920x1080"))
    return int(width), int(height)


def _light(text: str | None, image: str | None) -> dict[str, Any]:
    """Returns the environment of --env. image: id of an uploaded one, in place of a file."""
    if text is None:
        return {} if image is None else {"image": image}
    if text.startswith(SKY):
        numbers = text.removeprefix(SKY)
        elevation, *azimuth = _numbers("env", numbers, 1 + min(numbers.count(","), 1))
        return {"sky": {"elevation": elevation, "azimuth": azimuth[0] if azimuth else 0.0}}
    if text in PRESETS:
        return {"preset": text}
    if text.count(",") == 2:
        return {"color": _numbers("env", text, 3)}
    if image is None:
        raise _fault(
            Sentence(
                "template-environment-file",
                "--env names a file. Upload it by POST /api/environments, and give its id as `environment`",
            )
        )
    return {"image": image}


def _distortion(text: str) -> dict[str, Any]:
    model, *numbers = text.split(",")
    return {"model": model.strip(), "coefficients": [_number("distortion", number) for number in numbers]}


def _view(changes: dict[str, Any], cameras: Sequence[Mapping[str, Any]] | None, camera: str | None) -> dict[str, Any]:
    """Returns the view of the selected camera with the given options applied, as the command has it."""
    if cameras is None:
        if camera is None and {"eye", "target"} <= changes.keys():
            return changes
        raise _fault(
            Sentence(
                "template-view-unprepared",
                "its options change the view of the scene's camera, and the scene is not prepared yet. Try again later",
            )
        )
    start: dict[str, Any] = {}
    if cameras:
        start = cameras[camera_number([str(each["name"]) for each in cameras], camera)]["view"]
    return {**start, **changes}
