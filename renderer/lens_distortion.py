"""Lens distortion of a camera: Brown and Conrady's model, and OpenCV's of fisheye lenses."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from renderer.errors import SettingsError
from renderer.sentences import Sentence

__all__ = ["COEFFICIENTS", "MODELS", "LensDistortion"]

MODELS = ("brown", "fisheye")
COEFFICIENTS = {"brown": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"), "fisheye": ("k1", "k2", "k3", "k4")}
_LARGEST = 1e6


@dataclass(frozen=True)
class LensDistortion:
    """A lens distortion, with OpenCV's coefficients in OpenCV's order (COEFFICIENTS); those left out are 0.

    brown: a point at (x, y, 1) of the camera's space (y down) is seen at (x, y) times a rational function of r^2, plus the
    tangential terms (cv2.projectPoints). fisheye: a direction at an angle t from the line of sight is seen at the distance
    t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) from the middle (cv2.fisheye.projectPoints), in units of the focal length, which
    `fov` and the picture's height give as without distortion.
    """

    model: str
    coefficients: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise SettingsError(
                Sentence(
                    "distortion-model-unknown",
                    "distortion has the model {model}; known are {models}",
                    model=repr(self.model)[:60],
                    models=[*MODELS],
                ),
                field="distortion",
            )
        names = COEFFICIENTS[self.model]
        given = self.coefficients if isinstance(self.coefficients, list | tuple) else (None,)
        numbers = [float(each) for each in given if isinstance(each, int | float) and not isinstance(each, bool)]
        if len(numbers) < len(given) or len(given) > len(names) or not all(abs(each) <= _LARGEST for each in numbers):
            raise SettingsError(
                Sentence(
                    "distortion-coefficients-invalid",
                    "distortion has the coefficients {coefficients}; {model} takes at most {count} numbers: {names}",
                    coefficients=repr(self.coefficients)[:120],
                    model=self.model,
                    count=len(names),
                    names=[*names],
                ),
                field="distortion",
            )
        object.__setattr__(self, "coefficients", tuple(numbers))

    @classmethod
    def parse(cls, given: Any) -> LensDistortion | None:
        """Returns the distortion of a mapping with model and coefficients; None for None. Raises SettingsError."""
        if given is None or isinstance(given, cls):
            return given
        if not isinstance(given, Mapping) or not {"model"} <= {*given} <= {"model", "coefficients"}:
            raise SettingsError(
                Sentence(
                    "distortion-malformed",
                    "distortion is {value}; it takes a model and its coefficients",
                    value=repr(given)[:120],
                ),
                field="distortion",
            )
        return cls(given["model"], given.get("coefficients", ()))

    @property
    def is_rational(self) -> bool:
        """Returns True if the model is brown with a denominator: with one of k4, k5 and k6."""
        return self.model == "brown" and any(self.coefficients[5:])

    def to_json(self) -> dict[str, Any]:
        """Returns a JSON-ready dict for `parse`."""
        return {"model": self.model, "coefficients": list(self.coefficients)}

    def row(self, focal: float, middle: tuple[float, float]) -> tuple[float, ...]:
        """Returns the row of numbers that kernels read. focal: in pixels. middle: where the line of sight meets the picture."""
        rest = (0.0,) * (len(COEFFICIENTS["brown"]) - len(self.coefficients))
        return (float(MODELS.index(self.model)), focal, *middle, *self.coefficients, *rest)
