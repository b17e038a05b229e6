"""The tone curves of a service: built-in ones, and the views of the OpenColorIO config that its administrator set."""

from __future__ import annotations

from renderer.errors import SettingsError
from renderer.image import tonemap
from renderer.image.ocio import ColorConfig, View, ViewTransform, is_installed, is_view, open_config
from renderer.image.tonemap import Curve
from renderer.sentences import Sentence, with_full_stop
from service.errors import Invalid, StartupError

__all__ = ["OFF", "Curves"]

OFF = "off"  # setting: no views


class Curves:
    """Tone curves by the names that requests give. source: the setting RAYFARM_OCIO.

    Empty: the config `cg` if opencolorio is installed; `off`: built-in curves only. Raises StartupError if the config cannot be
    opened.
    """

    def __init__(self, source: str) -> None:
        self._config: ColorConfig | None = None
        if source != OFF and (source or is_installed()):
            try:
                self._config = open_config(source or "cg")
            except SettingsError as error:
                raise StartupError(f"RAYFARM_OCIO: {error}. Change or unset it.") from error

    @property
    def views(self) -> tuple[View, ...]:
        """The views of the config, those of its default display first."""
        return () if self._config is None else tuple(sorted(self._config.views, key=lambda view: not view.is_default))

    def find(self, name: str) -> Curve:
        """Returns the tone curve of this name. Raises Invalid if it is unknown."""
        if is_view(name):
            return self.find_view(name)
        if name not in tonemap.CURVES:
            known = [*tonemap.CURVES, *(["ocio:VIEW"] if self._config else [])]
            raise Invalid(
                Sentence(
                    "tonemap-unknown",
                    "tonemap: {name} is not a tone curve; the curves are {curves}.",
                    name=repr(name[:60]),
                    curves=known,
                )
            )
        return name

    def find_view(self, name: str) -> ViewTransform:
        """Returns the view of this name. Raises Invalid if it is unknown. The first use of a view takes up to 0.2 s."""
        if self._config is None:
            raise Invalid(
                Sentence(
                    "ocio-not-on-farm",
                    "tonemap: this farm has no OCIO views; its administrator can install rayfarm[ocio] and set RAYFARM_OCIO.",
                )
            )
        try:
            return self._config.find(name)
        except SettingsError as error:
            raise Invalid(with_full_stop(error)) from None
