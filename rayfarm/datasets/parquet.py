"""The manifest of a data set as one Parquet table, a row a view."""

from __future__ import annotations

import io
import json
from itertools import chain
from pathlib import Path
from typing import Any

from rayfarm.datasets.folder import Description, Views
from rayfarm.output_files import write

__all__ = ["write_parquet"]


def write_parquet(folder: Path, description: Description, views: Views) -> None:
    """Writes manifest.parquet: view, digest, poses (16 numbers, row by row), OUTPUT and OUTPUT_sha256, and variation as JSON.

    An output that a view does not have is null. Size, intrinsics and settings are in the table's metadata, key `dataset`. Needs
    pyarrow.
    """
    import pyarrow as pa
    from pyarrow import parquet

    matrix = pa.list_(pa.float64(), 16)
    outputs = sorted({output for view in views for output in view["files"]})
    columns: dict[str, Any] = {
        "view": pa.array([view["view"] for view in views], pa.int64()),
        "digest": pa.array([view["digest"] for view in views], pa.string()),
        **{
            name: pa.array([list(chain.from_iterable(view[name])) for view in views], matrix)
            for name in ("camera_to_world_opengl", "world_to_camera_opencv")
        },
        "variation": pa.array([json.dumps(view["variation"]) if "variation" in view else None for view in views], pa.string()),
    }
    for output in outputs:
        found = [view["files"].get(output, {}) for view in views]
        columns[output] = pa.array([each.get("path") for each in found], pa.string())
        columns[f"{output}_sha256"] = pa.array([each.get("sha256") for each in found], pa.string())
    table = pa.table(columns).replace_schema_metadata({"dataset": json.dumps(description)})
    out = io.BytesIO()
    parquet.write_table(table, out)
    write(folder / "manifest.parquet", out.getvalue())
