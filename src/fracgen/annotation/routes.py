"""The routes of the page. What a tab may see and change lies below its token."""

import json
import shutil
import tempfile
from dataclasses import asdict
from pathlib import Path
from typing import Any, Literal

import anyio.to_thread
from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, Response

from fracgen.annotation import commands, presets, preview, uploads
from fracgen.annotation.jobs import Job, told
from fracgen.annotation.place import Command, Place, Shared, Tab
from fracgen.annotation.sessions import Session, UnknownError
from fracsim.scene import condition as condition_file
from fracsim.scene.condition import Condition

STATIC = Path(__file__).parent / "static"
NO_RUN = "There is no checkpoint: start the page with --run FOLDER of a training."
Fit = Literal["fit", "crop"]
site, tab = APIRouter(), APIRouter(prefix="/session/{token}")


@site.get("/")
def page() -> FileResponse:
    """The page."""
    return FileResponse(STATIC / "index.html")


@site.get("/favicon.ico", status_code=204)
def favicon() -> Response:
    """No picture: browsers ask for one."""
    return Response(status_code=204)


@site.get("/setup")
def setup(place: Shared) -> dict[str, Any]:
    """What the page is made of: presets, the default pull, ranges, caps, the model's size, the images."""
    s = place.settings
    return {
        "presets": presets.presets(),
        "pull": presets.pull(),
        "bytes": uploads.PICTURE_BYTES,
        "ranges": presets.ranges(),
        "size": asdict(s.size),
        "no_generator": "" if s.generate else NO_RUN,
        "images": [{"name": path.name, "saved": s.album.file(i).exists()} for i, path in enumerate(s.album.images)],
    }


@site.post("/session")
def begin(place: Shared) -> dict[str, str]:
    """A token for a new tab."""
    return {"token": place.sessions.begin().token}


@tab.post("/end")
def end(session: Tab, place: Shared) -> None:
    """The tab is closed."""
    place.sessions.end(session.token)


@tab.put("/picture")
async def upload(session: Tab, request: Request) -> dict[str, Any]:
    """Open the picture in the body."""
    content = await uploads.body(request, uploads.PICTURE_BYTES)
    return await anyio.to_thread.run_sync(session.take, content)


@tab.post("/open/{index}")
def choose(session: Tab, place: Shared, index: int) -> dict[str, Any]:
    """Open an image of the album, with the condition beside it."""
    album = place.settings.album
    if not 0 <= index < len(album.images):
        raise UnknownError(f"There is no image {index}.")
    opened = session.choose(album.images[index], index, album.mask(index))
    try:
        saved = album.saved(index)
    except ValueError as error:
        return {**opened, "condition": None, "note": f"{album.file(index).name} cannot be used: {error}"}
    return {**opened, "condition": saved}


@tab.get("/picture.jpg")
def picture(session: Tab) -> FileResponse:
    """The picture as the page shows it."""
    return FileResponse(session.picture.folder / "shown.jpg")


@tab.get("/mask.png")
def mask(session: Tab) -> FileResponse:
    """The cut-out, white on the object, in the size of the picture."""
    return FileResponse(session.picture.mask)


@tab.put("/mask")
async def paint(session: Tab, request: Request) -> dict[str, Any]:
    """Take the cut-out in the body."""
    content = await uploads.body(request, uploads.MASK_BYTES)
    return await anyio.to_thread.run_sync(session.paint, content)


@tab.post("/mask/again")
def cut_again(session: Tab) -> dict[str, Any]:
    """Find the object again."""
    return session.cut_again()


@tab.get("/reference.jpg")
def reference(session: Tab, place: Shared, fit: Fit) -> Response:
    """The picture as the model sees it."""
    return Response(preview.reference(session.picture.path, place.settings.size, fit), media_type="image/jpeg")


@tab.get("/force.png")
def force(session: Tab, place: Shared, condition: str, fit: Fit, once: bool = False) -> Response:
    """The loading as the model sees it, shown once or without end."""
    frames = preview.force(_condition(condition), session.picture.size, place.settings.size, fit)
    return Response(preview.animation(frames, once), media_type="image/png")


@tab.get("/box")
def box(session: Tab, place: Shared, fit: Fit) -> list[float]:
    """Where the model's picture lies in this one: left, top, width and height."""
    return preview.box(session.picture.size, place.settings.size, fit)


@tab.get("/numbers")
def numbers(condition: str) -> dict[str, Any]:
    """The numbers that the model will see."""
    return preview.numbers(_condition(condition))


@tab.get("/condition.json")
def export(condition: str) -> Response:
    """The condition as a file."""
    attached = {"content-disposition": "attachment"}
    return Response(condition_file.text(_condition(condition)), media_type="application/json", headers=attached)


@tab.post("/condition")
async def check(request: Request) -> Condition:
    """The condition in a file, all fields set."""
    return _condition(await uploads.body(request, uploads.JSON_BYTES))


@tab.put("/saved")
async def save(session: Tab, place: Shared, request: Request) -> dict[str, str]:
    """Write the condition beside the image of the album that is open."""
    value = _condition(await uploads.body(request, uploads.JSON_BYTES))
    index = session.picture.index
    if index is None:
        raise ValueError("The picture was not opened from the folder: export the condition instead.")
    return {"name": (await anyio.to_thread.run_sync(place.settings.album.save, index, value)).name}


@tab.get("/jobs")
def jobs(session: Tab, place: Shared) -> list[dict[str, Any]]:
    """The jobs on the picture that is open."""
    number = session.picture.number
    return [told(job, place.queue) for job in place.queue.of(session.token) if job.picture == number]


@tab.post("/jobs/{kind}")
async def start(session: Tab, place: Shared, kind: Literal["simulate", "generate"], fit: Fit,
                request: Request) -> dict[str, Any]:  # fmt: skip
    """Start a simulation or the generator with the condition in the body."""
    value = _condition(await uploads.body(request, uploads.JSON_BYTES))
    command = place.settings.simulate if kind == "simulate" else place.settings.generate
    if command is None:
        raise ValueError(NO_RUN)
    job = await anyio.to_thread.run_sync(_job, session, kind, command, (value, fit))
    place.queue.add(job)
    return told(job, place.queue)


def _job(session: Session, kind: str, command: Command, asked: tuple[Condition, Fit]) -> Job:
    """A job with copies of all that may change while it waits; raises ValueError where there is no object."""
    with session.lock:
        if session.cutout()["object"] is None:
            raise ValueError("There is no cut-out: paint the object first.")
        there, (value, fit) = session.picture, asked
        folder = Path(tempfile.mkdtemp(prefix=f"{kind}-", dir=session.folder))
        shutil.copy(there.mask, folder / "mask.png")
        condition_file.save(value, folder / "condition.json")
    task = commands.Task(
        there.path, folder / "mask.png", folder / "condition.json", value.category, fit, folder / "out"
    )
    return Job(session.token, kind, there.number, command(task), task.output)


@tab.delete("/jobs/{job}")
def cancel(session: Tab, place: Shared, job: str) -> None:
    """Cancel a job."""
    place.queue.cancel(_find(session, place, job))


@tab.get("/jobs/{job}/film.mp4")
def film(session: Tab, place: Shared, job: str) -> FileResponse:
    """What a job has made: all pictures side by side."""
    made = _find(session, place, job).film
    if made is None:
        raise UnknownError("There is no film.")
    return FileResponse(made, media_type="video/mp4")


def _find(session: Session, place: Place, name: str) -> Job:
    """A job of a session; raises UnknownError for one that it has not."""
    for job in place.queue.of(session.token):
        if job.id == name:
            return job
    raise UnknownError("There is no such job.")


def _condition(content: str | bytes) -> Condition:
    """The condition in JSON; raises ValueError naming what is wrong."""
    try:
        found = json.loads(content)
    except (ValueError, RecursionError):
        raise ValueError("condition: this is no JSON; give a file that this page has exported.") from None
    return condition_file.parse(found, "condition")
