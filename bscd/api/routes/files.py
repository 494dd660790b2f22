"""What was recorded, calibrated, measured and reported: catalogues and downloads."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, Path
from fastapi.responses import FileResponse

from bscd.api.security import TheDaemon, Viewer
from bscd.daemon.documents import FileDocument
from bscd.daemon.files import FileKind

router = APIRouter(tags=["files"])

FileName = Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,119}$", description="without its ending")]

_PLACES: tuple[tuple[str, FileKind], ...] = (
    ("runs", "run"),
    ("calibrations", "calibration"),
    ("results", "result"),
    ("reports", "report"),
)

_WHOLE: dict[int | str, dict[str, Any]] = {
    200: {"description": "all of it", "content": {"application/x-hdf5": {}}},
    206: {"description": "the range that was asked for"},
    416: {"description": "no such range"},
}


def _add(place: str, kind: FileKind) -> None:
    @router.get(f"/{place}", operation_id=f"list_{place}")
    def catalogue(daemon: TheDaemon, who: Viewer) -> list[FileDocument]:
        """All of them, the newest first."""
        return daemon.files.list(kind)

    @router.get(f"/{place}/{{name}}", operation_id=f"about_{kind}")
    def about(daemon: TheDaemon, who: Viewer, name: FileName) -> FileDocument:
        """What its header tells."""
        return daemon.files.about(kind, name)

    if kind == "report":
        return

    @router.get(
        f"/{place}/{{name}}/file", operation_id=f"download_{kind}", response_class=FileResponse, responses=_WHOLE
    )
    def download(daemon: TheDaemon, who: Viewer, name: FileName) -> FileResponse:
        """The file, or a range of it; one that is still written as far as it is there."""
        path = daemon.files.path(kind, name)
        return FileResponse(path, media_type="application/x-hdf5", filename=path.name)


for _place, _kind in _PLACES:
    _add(_place, _kind)


@router.get(
    "/reports/{name}/{file}",
    response_class=FileResponse,
    responses=_WHOLE | {200: {"description": "the page or a picture", "content": {"text/html": {}}}},
)
def report_file(
    daemon: TheDaemon,
    who: Viewer,
    name: FileName,
    file: Annotated[str, Path(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,119}$", description="report.html or a picture")],
) -> FileResponse:
    """A report's page, or a picture of it."""
    return FileResponse(daemon.files.report_file(name, file))
