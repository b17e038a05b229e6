"""Notebook widget whose picture is updated as samples arrive, with controls for exposure, tone curve and zoom.

Needs anywidget (pip install "rayfarm[notebook]"). notebook_widget.js, the browser half, receives radiance, so exposure
changes need no round trip to Python.
"""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Callable, Generator, Iterable
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from rayfarm.library.image import Image
from rayfarm.responses import Job, Scene
from renderer.errors import RayfarmError, SettingsError
from renderer.image import rgbe9995

__all__ = ["has_widgets", "show"]

_MISSING_ANYWIDGET = 'A picture that grows in a notebook needs anywidget: pip install "rayfarm[notebook]"'


def show(what: Any, *, farm: Any = None, exposure: float = 0.0, **settings: Any) -> Any:
    """Returns a widget with the picture, which updates until it is final; make it a cell's last value to display it.

        rayfarm.show("truck.glb", spp=256)                    # rendered here
        rayfarm.show(scene, farm="http://studio:8000")        # on a farm
        rayfarm.show(job, farm="http://studio:8000")          # an existing job of a farm

    what: an Image, an iterator of Images such as `progressive` returns, a Job or Scene of a farm, or any scene that `render`
    accepts. exposure: initial exposure in stops. settings: as for `render`. The widget's `wait()` returns the final Image, its
    `stop()` ends rendering. Raises SettingsError if anywidget is missing.
    """
    widget = _widget_class()(exposure=exposure)
    if isinstance(what, Image):
        widget.display(what)
    else:
        widget.follow(lambda: _images(what, farm, settings))
    return widget


def _images(what: Any, farm: Any, settings: dict[str, Any]) -> Generator[Image]:
    if isinstance(what, Job | Scene):
        yield from _of_farm(what, farm, settings)
    elif isinstance(what, Iterable) and not isinstance(what, str | Path | dict) and not hasattr(what, "export"):
        yield from what
    else:
        from rayfarm.library.render import progressive

        yield from progressive(what, farm=farm, **settings)


def _of_farm(what: Job | Scene, farm: Any, settings: dict[str, Any]) -> Generator[Image]:
    from rayfarm.library.arguments import parse_arguments
    from rayfarm.library.farm_render import images, submit_ready_scene
    from rayfarm.login import farm_client

    with ExitStack() as stack:
        client = stack.enter_context(farm_client(farm)) if farm is None or isinstance(farm, str) else farm
        wanted = parse_arguments({"aovs": (), **settings})
        job = what if isinstance(what, Job) else submit_ready_scene(client, client.wait_for_scene(what.id), wanted)
        yield from images(client, job.id, wanted)


def has_widgets() -> bool:
    """Returns True if `show` works in this environment, which needs anywidget."""
    return importlib.util.find_spec("anywidget") is not None


def _widget_class() -> Any:
    try:
        import anywidget
        import traitlets
    except ImportError:
        raise SettingsError(_MISSING_ANYWIDGET) from None

    class Shown(anywidget.AnyWidget):  # type: ignore[misc,unused-ignore]
        """Notebook widget that displays a picture. `pixels`: RGB9E5 words, rows from the top."""

        _esm = Path(__file__).with_suffix(".js")
        width = traitlets.Int(0).tag(sync=True)
        height = traitlets.Int(0).tag(sync=True)
        pixels = traitlets.Bytes(b"").tag(sync=True)  # type: ignore[call-arg,unused-ignore]
        exposure = traitlets.Float(0.0).tag(sync=True)
        status = traitlets.Unicode("").tag(sync=True)
        progress = traitlets.Float(0.0).tag(sync=True)  # 0 to 1
        is_over = traitlets.Bool(False).tag(sync=True)
        image: Image | None = None

        def display(self, image: Image) -> None:
            """Displays a picture."""
            self.image = image
            color = image["denoised"] if "denoised" in image else image["color"]
            noise = "" if image.noise is None else f", noise {image.noise:.2g}"
            of = "" if image.of is None or image.is_final else f" of {image.of:,}"
            with self.hold_sync():
                self.height, self.width = color.shape[:2]
                self.pixels = rgbe9995.pack(color).astype("<u4").tobytes()
                self.status = f"{image.width} × {image.height}, {image.spp:,.4g}{of} samples per pixel{noise}"
                self.progress = 1.0 if image.is_final or not image.of else min(image.spp / image.of, 1.0)
                self.is_over = image.is_final

        def follow(self, begin: Callable[[], Generator[Image]]) -> None:
            """Displays the pictures of an iterator as they arrive, from a separate thread."""
            self._left = threading.Event()
            self._error: BaseException | None = None
            self.status = "Preparing"
            self._thread = threading.Thread(target=self._run, args=(begin,), name="rayfarm-shown", daemon=True)
            self._thread.start()

        def _run(self, begin: Callable[[], Generator[Image]]) -> None:
            try:
                with closing(begin()) as images:
                    for image in images:
                        self.display(image)
                        if self._left.is_set():
                            break
            except RayfarmError as error:
                self._error = error
                self.status = str(error)
            except BaseException as error:
                self._error = error
                self.status = f"{type(error).__name__}: {error}"
            finally:
                self.is_over = True

        def wait(self) -> Image:
            """Waits for the final picture and returns it. Raises the error that ended rendering, if any."""
            if hasattr(self, "_thread"):
                self._thread.join()
                if self._error is not None:
                    raise self._error
            assert self.image is not None
            return self.image

        def stop(self) -> None:
            """Ends the rendering. The present picture stays."""
            if hasattr(self, "_thread"):
                self._left.set()

    return Shown
