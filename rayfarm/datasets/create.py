"""Data sets as a function: renders many views of a scene, annotates them, and writes them to a folder."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Generator, Iterable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from rayfarm.datasets.cameras import opencv
from rayfarm.datasets.folder import Folder, plane_bytes
from rayfarm.datasets.pictures import RenderedView, rendered_by_farm, rendered_here
from rayfarm.datasets.request import Request, parse_request
from rayfarm.datasets.s3 import Bucket, check_sink
from rayfarm.datasets.sinks import SINK_WRITERS
from rayfarm.library.scene_input import as_files
from renderer import __version__

if TYPE_CHECKING:
    from rayfarm.client import Client
    from rayfarm.datasets.annotate import Annotator
    from rayfarm.reading import ConfinedScene

__all__ = ["Dataset", "dataset"]


@dataclass(frozen=True)
class Dataset:
    """A complete data set. views: the lines of its manifest, in order. seconds: what this run took, in all and for annotation."""

    folder: Path
    description: dict[str, Any]
    views: list[dict[str, Any]]
    seconds: dict[str, float] = field(default_factory=dict)

    @property
    def digests(self) -> list[str]:
        """Returns the digest of each view's film."""
        return [view["digest"] for view in self.views]


def dataset(
    scene: Any,
    cameras: Any,
    *,
    folder: str | Path,
    intrinsics: Any = None,
    fov: float | None = None,
    convention: str = "opengl",
    outputs: Iterable[str] = ("color",),
    sinks: Iterable[str] = (),
    categories: Mapping[str, str] | None = None,
    picture_format: str = "png",
    plane_format: str = "npy",
    vary: Mapping[str, Any] | Literal[False] | None = None,
    distortion: Any = None,
    sink: str | None = None,
    farm: str | Client | None = None,
    base: str | Path = ".",
    watch: Callable[[int, int], None] = lambda done, total: None,
    **settings: Any,
) -> Dataset:
    """Renders and annotates views of a scene, writes them to a folder as they end, and returns the complete data set.

        rayfarm.dataset("room.glb", Cameras.orbit(100, radius=3), fov=50, width=256, height=256, spp=64, folder="room",
                        outputs=["color", "depth", "instance", "boxes", "masks"], sinks=["coco"], farm="http://studio:8000")

    scene, base: as for `render`. cameras: poses (N, 4, 4) from camera to world space, or Cameras. convention: of an array's
    cameras, opengl or opencv. intrinsics: 3 x 3, in pixels; or fov, vertical, in degrees (default 50). distortion: of the lens, a
    mapping with `model` (brown, fisheye) and `coefficients` in OpenCV's order. outputs: of OUTPUTS. sinks: further forms: coco,
    transforms, webdataset, hdf5, bop, parquet. categories: names by patterns of object names. picture_format: png, jpg or exr;
    plane_format: npy or exr. vary: how the scene varies from view to view, by seed (docs/datasets.md); by default as the scene
    file says, False for not at all. sink: s3://bucket/prefix, where the folder is copied to as views end. farm: a URL or Client;
    None: rendered in this process. watch: called with the number of complete views, and of all. settings: those of `render`:
    width, height, spp, seed ...

    A run that was interrupted continues when it is called again: complete views are kept. View n is frame n of the scene's time.
    Raises RayfarmError, or TypeError for an unknown keyword.
    """
    begun = time.perf_counter()
    with ExitStack() as stack:
        path = stack.enter_context(as_files(scene, base))
        names = (outputs, sinks, categories, picture_format, plane_format, vary, distortion)
        request = parse_request(path, cameras, intrinsics, fov, convention, *names, settings)
        bucket = None if sink is None else Bucket(check_sink(sink))
        place = Folder(Path(folder).expanduser(), request.identity)
        if bucket is not None:
            bucket.open(place)
        missing = [number for number in range(len(request.views)) if number not in place.views]
        watch(len(place.views), len(request.views))
        seconds = {"annotation": 0.0}
        if missing:
            client = _client(farm, stack)
            stage = stack.enter_context(_open_stage(request, path))
            annotator = _annotator(request, stage)
            place.describe(_description(request, path, annotator))
            if bucket is not None:
                bucket.begin(place)
            pictures = _pictures(request, path, client, stage, place, missing)
            with closing(pictures):
                for picture in pictures:
                    if picture is not None:
                        _write_view(request, place, annotator, picture, seconds)
                        if bucket is not None:
                            bucket.add_view(place, picture.number)
                        watch(len(place.views), len(request.views))
    description = json.loads((place.path / "dataset.json").read_text())
    views = [place.views[number] for number in sorted(place.views)]
    for name in request.sinks:
        SINK_WRITERS[name](place.path, description, views)
    if bucket is not None:
        if not missing:
            bucket.begin(place)
        bucket.end(place)
    return Dataset(place.path, description, views, {**seconds, "all": time.perf_counter() - begun})


def _client(farm: str | Client | None, stack: ExitStack) -> Client | None:
    if not isinstance(farm, str):
        return farm
    from rayfarm.login import farm_client

    return stack.enter_context(farm_client(farm))


def _open_stage(request: Request, path: Path) -> Any:
    from rayfarm.reading import open_stage

    picture = request.arguments.picture
    return open_stage(
        *(path, picture.environment(), request.arguments.variant, None),
        threads=request.arguments.threads,
        shutter=picture.shutter(),
        placement=picture.placement(),
        vary=request.vary,
    )


def _annotator(request: Request, stage: ConfinedScene) -> Annotator:
    from rayfarm.datasets.annotate import Annotator

    moment = request.arguments.moment
    return Annotator(
        *(stage, _settings_of(request), request.views, request.outputs, request.categories),
        *(moment.fps, moment.clip, request.arguments.threads),
        0 if request.vary is None else request.vary.get("every", 1),
    )


def _settings_of(request: Request) -> Callable[[dict[str, Any]], Any]:
    return lambda summary: request.arguments.picture.settings(summary["cameras"], summary["defaults"])


def _pictures(
    request: Request, path: Path, farm: Client | None, stage: ConfinedScene, folder: Folder, missing: list[int]
) -> Generator[RenderedView | None]:
    """Yields the pictures of the missing views; without the output `color`, views without a picture."""
    if "color" not in request.outputs:
        yield from (RenderedView(number, b"", "") for number in missing)
    elif farm is None:
        yield from rendered_here(request, stage, _settings_of(request), missing)
    else:
        yield from rendered_by_farm(request, path, farm, folder, missing)


def _write_view(request: Request, folder: Folder, annotator: Annotator, picture: RenderedView, seconds: dict[str, float]) -> None:
    begun = time.perf_counter()
    found = annotator.annotate(picture.number)
    seconds["annotation"] += time.perf_counter() - begun
    number, files = picture.number, {}
    if picture.data:
        files["color"] = folder.write_file("color", number, request.picture_format, picture.data)
    for name, plane in found.planes.items():
        files[name] = folder.write_file(name, number, request.plane_format, plane_bytes(plane, request.plane_format))
    if found.bodies is not None:
        files["boxes"] = folder.write_file("boxes", number, "json", json.dumps(found.bodies).encode())
    pose = request.poses[number]
    line = {
        "view": number,
        "digest": picture.digest,
        "files": files,
        "camera_to_world_opengl": pose.tolist(),
        "world_to_camera_opencv": opencv(pose).tolist(),
        **({"variation": found.variation} if found.variation else {}),
    }
    folder.add_view(line)


def _description(request: Request, path: Path, annotator: Annotator) -> dict[str, Any]:
    return {
        "version": __version__,
        "scene": path.stem,
        "identity": request.identity,
        "views": len(request.views),
        "width": request.width,
        "height": request.height,
        "intrinsics": request.intrinsics.tolist(),
        **({"distortion": request.distortion.to_json()} if request.distortion is not None else {}),
        **({"rolling_shutter": annotator.rolling_shutter} if annotator.rolling_shutter is not None else {}),
        "outputs": list(request.outputs),
        "settings": request.settings,
        **({"vary": request.vary} if request.vary is not None else {}),
        "objects": annotator.objects,
        "materials": annotator.materials,
        "categories": annotator.categories,
    }
