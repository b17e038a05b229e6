"""Uploads of a single file, with checks of its size before and during the transfer."""

from __future__ import annotations

from pathlib import PurePosixPath

from fastapi import Request
from starlette.concurrency import run_in_threadpool

from renderer.sentences import Sentence
from service.access.visit import Visit
from service.errors import Invalid
from service.farm import Farm
from service.http.problems import Problem
from service.http.security import exceeds_limit
from service.intake.multipart import Form, read_form
from service.intake.names import safe_name
from service.intake.uploads import joined_chunks
from service.store.disk_space import disk_checker, translated_disk_errors
from service.store.staging import BlobWriter

__all__ = ["UPLOAD_FORM", "check_length", "check_upload_quota", "only_file", "read_single_upload"]

MAX_NAME_LENGTH = 200  # characters of a file name
UPLOAD_FORM = {
    "requestBody": {
        "required": True,
        "content": {
            "multipart/form-data": {
                "schema": {
                    "type": "object",
                    "required": ["file"],
                    "properties": {"file": {"type": "string", "format": "binary", "description": "the file to upload"}},
                }
            }
        },
    }
}


def check_length(request: Request, farm: Farm, what: str, way_out: str = Sentence("advice-shrink", "Make it smaller")) -> None:
    """Rejects a body whose Content-Length exceeds the limit, before any of it is read. Raises Problem.

    what: name of the uploaded object, and way_out: advice, both inserted into the error message.
    """
    limit = farm.settings.max_upload_bytes
    if exceeds_limit(request.headers.get("content-length", ""), limit):
        sentence = Sentence(
            "upload-image-too-large",
            "The {kind} is larger than the {most} bytes allowed. {advice}, or ask the administrator of this farm.",
            kind=what,
            most=limit,
            advice=way_out,
        )
        raise Problem(413, sentence, headers={"Connection": "close"})


async def check_upload_quota(request: Request, farm: Farm, visit: Visit) -> None:
    """Rejects an upload if the caller's storage quota is used up, before any of it is read. Raises OutOfSpace."""
    length = request.headers.get("content-length", "")
    size = int(length) if length.isascii() and length.isdigit() and len(length) < 19 else 0
    await run_in_threadpool(farm.quotas.check_bytes, visit.caller, size)


async def read_single_upload(request: Request, farm: Farm, what: str) -> Form:
    """Parses the upload of one file and writes it to disk. The caller must discard the form. Raises FarmError."""
    check_length(request, farm, what)
    limit = farm.settings.max_upload_bytes
    check_disk = disk_checker(farm.settings.data, farm.settings.min_free_bytes)
    with translated_disk_errors():
        chunks = joined_chunks(request.stream())
        return await read_form(request.headers.get("content-type", ""), chunks, farm.blobs, 1, limit, check_disk)


def only_file(form: Form, suffixes: tuple[str, ...], address: str, what: str) -> tuple[str, BlobWriter]:
    """Returns the base name and the content of the only file in a form. Raises Invalid.

    suffixes: accepted file name suffixes. address: the upload's URL path, for the message about an empty form. what: why a file
    with another suffix is rejected, for the message.
    """
    if len(form.files) != 1 or form.files[0][1].size == 0:
        raise Invalid(
            Sentence(
                "upload-image-empty",
                "The upload is empty. Send one image as `file`: curl URL{address} -F file=@picture.exr.",
                address=address,
            )
        )
    name, writer = form.files[0]
    plain = PurePosixPath(safe_name(name)).name
    if PurePosixPath(plain).suffix.lower() not in suffixes:
        raise Invalid(
            Sentence(
                "upload-image-format-unknown",
                "{name} is {fault}; give one of {formats}, best an .exr or .hdr.",
                name=plain,
                fault=what,
                formats=[*suffixes],
            )
        )
    stem, suffix = PurePosixPath(plain).stem, PurePosixPath(plain).suffix
    return stem[: MAX_NAME_LENGTH - len(suffix)] + suffix, writer
