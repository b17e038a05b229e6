"""The camera's position, projection and lens."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Annotated, Any

from renderer.errors import SettingsError
from renderer.lens_distortion import LensDistortion
from renderer.sentences import Sentence
from renderer.setting_declaration import Choices, Setting, SettingTexts, checked, table

__all__ = ["MAX_DISTANCE", "MAX_SHIFT", "PROJECTIONS", "VIEW", "Vec3", "View"]

Vec3 = tuple[float, float, float]

MAX_DISTANCE = 1e15  # squares and products of it stay within float32
MIN_DISTANCE = 1e-12
MAX_SHIFT = 100.0

PROJECTIONS = Choices(
    {
        "perspective": SettingTexts("Perspective", "Natural view: distant objects look smaller."),
        "orthographic": SettingTexts("Orthographic", "Without perspective, as on a plan: distance does not change size."),
        "panorama": SettingTexts("Panorama", "360° picture around the camera, twice as wide as high (equirectangular)."),
    }
)

_lens = ("perspective",)


@dataclass(frozen=True)
class View:
    """A camera: world-space `eye` and `target`, and an `up` hint; lengths in the scene's unit.

    projection: perspective, with the vertical field of view `fov` in degrees; orthographic, with `height` units from top to
    bottom; or panorama, all directions around the eye as an equirectangular image (`fov` unused).
    aperture: radius of the thin lens of a perspective camera; 0 for a pinhole, sharp everywhere.
    focus: distance along the line of sight of the plane in focus; None for the target's.
    near: distance along the line of sight where rays start (near clipping); not used by a panorama.
    shift_x, shift_y: offset of the image's centre to the right of the line of sight, and above it, in heights of the image
    (lens shift); not used by a panorama. Vertical lines stay vertical, unlike with a rotated camera.
    distortion: of a perspective camera without an aperture; a mapping is converted.
    """

    eye: Annotated[
        Vec3,
        Setting(-MAX_DISTANCE, MAX_DISTANCE),
        SettingTexts("Eye", "Position of the camera.", section="View", phrase="from {}"),
    ]
    target: Annotated[
        Vec3,
        Setting(-MAX_DISTANCE, MAX_DISTANCE),
        SettingTexts("Target", "Point the camera looks at.", section="View", phrase="to {}"),
    ]
    up: Annotated[
        Vec3,
        Setting(-MAX_DISTANCE, MAX_DISTANCE),
        SettingTexts("Up", "Direction that points up in the picture; not along the line of sight.", section="View"),
    ] = (0.0, 1.0, 0.0)
    fov: Annotated[
        float,
        Setting(0.01, 179.0),
        SettingTexts(
            "Field of view",
            "Vertical angle of view: larger shows more of the scene.",
            unit="°",
            section="View",
            projections=_lens,
            phrase="{}°",
            usual=(10.0, 120.0),
        ),
    ] = 40.0
    projection: Annotated[
        str,
        Setting(choices=PROJECTIONS),
        SettingTexts("Projection", "With perspective, parallel, or all around.", section="View"),
    ] = "perspective"
    aperture: Annotated[
        float,
        Setting(0.0, MAX_DISTANCE),
        SettingTexts(
            "Aperture",
            "Radius of the lens in scene units. Larger: more blur before and behind the focus; 0: all sharp.",
            unit="scene units",
            section="View",
            projections=_lens,
        ),
    ] = 0.0
    focus: Annotated[
        float | None,
        Setting(MIN_DISTANCE, MAX_DISTANCE),
        SettingTexts(
            "Focus distance",
            "Distance from the camera at which objects are sharp; by default the target's.",
            unit="scene units",
            section="View",
            projections=_lens,
            off=Sentence("setting-off-target", "the target's"),
            phrase="focus {}",
        ),
    ] = None
    height: Annotated[
        float,
        Setting(MIN_DISTANCE, MAX_DISTANCE),
        SettingTexts(
            "View height",
            "Height of the visible part of the scene, in scene units.",
            unit="scene units",
            section="View",
            projections=("orthographic",),
            option="ortho-height",
            phrase="{} high",
        ),
    ] = 2.0
    near: Annotated[
        float,
        Setting(0.0, MAX_DISTANCE),
        SettingTexts(
            "Near plane",
            "Hides everything nearer to the camera than this, to look into closed rooms.",
            unit="scene units",
            section="View",
            projections=("perspective", "orthographic"),
            phrase="near {}",
        ),
    ] = 0.0
    shift_x: Annotated[
        float,
        Setting(-MAX_SHIFT, MAX_SHIFT),
        SettingTexts(
            "Shift to the right",
            "Lens shift: shows more on the right without turning the camera, in picture heights.",
            section="View",
            projections=("perspective", "orthographic"),
            phrase="shifted {} to the right",
            usual=(-1.0, 1.0),
        ),
    ] = 0.0
    shift_y: Annotated[
        float,
        Setting(-MAX_SHIFT, MAX_SHIFT),
        SettingTexts(
            "Shift up",
            "Lens shift: shows more above without tilting the camera, so verticals stay vertical; in picture heights.",
            section="View",
            projections=("perspective", "orthographic"),
            phrase="shifted {} up",
            usual=(-1.0, 1.0),
        ),
    ] = 0.0
    distortion: LensDistortion | None = None

    def __post_init__(self) -> None:
        checked(self)
        object.__setattr__(self, "distortion", LensDistortion.parse(self.distortion))
        if self.distortion is not None and (self.projection != "perspective" or self.aperture > 0):
            raise SettingsError(
                Sentence(
                    "distortion-projection-invalid",
                    "distortion is of perspective cameras without an aperture; leave out the distortion or the aperture",
                ),
                field="distortion",
            )
        if all(abs(e - t) < 1e-12 for e, t in zip(self.eye, self.target, strict=True)):
            raise SettingsError(Sentence("view-target-at-eye", "eye and target are the same point; move one of them"))
        d = [t - e for e, t in zip(self.eye, self.target, strict=True)]
        u = self.up
        cross = (d[1] * u[2] - d[2] * u[1], d[2] * u[0] - d[0] * u[2], d[0] * u[1] - d[1] * u[0])
        if sum(c * c for c in cross) <= 1e-12 * sum(c * c for c in d) * max(sum(c * c for c in u), 1e-300):
            raise SettingsError(
                Sentence("view-up-parallel", "the up vector is zero or parallel to the line of sight; use another up vector")
            )

    def middle(self, width: int, height: int) -> tuple[float, float]:
        """Returns the pixel position, from the upper left corner, at which the line of sight intersects an image of that size."""
        if self.projection == "panorama":
            return width / 2, height / 2
        return width / 2 - self.shift_x * height, height / 2 + self.shift_y * height

    def to_json(self) -> dict[str, Any]:
        """Returns a JSON-ready dict, from which `from_json` restores the view.

        Without a lens shift or a distortion, the dict is the same as in older releases.
        """
        found = {name: value for name, value in asdict(self).items() if value or not name.startswith(("shift_", "distortion"))}
        return found if self.distortion is None else {**found, "distortion": self.distortion.to_json()}

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> View:
        """Returns the view of a dict from `to_json`. Raises SettingsError if it is invalid."""
        try:
            return cls(**data)
        except TypeError as error:
            raise SettingsError(
                Sentence("view-release-mismatch", "this view comes from another release of Rayfarm ({error})", error=error)
            ) from None


VIEW = table(View)
