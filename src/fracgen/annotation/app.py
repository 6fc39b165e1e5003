"""The server of the page."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from typing import Any

import anyio.to_thread
from fastapi import FastAPI, Request
from fastapi.responses import JSONResponse
from fastapi.staticfiles import StaticFiles

from fracgen.annotation import presets, routes
from fracgen.annotation.guard import Guard
from fracgen.annotation.jobs import FullError
from fracgen.annotation.place import Place, Settings
from fracgen.annotation.sessions import UnknownError
from fracgen.annotation.uploads import TooLargeError

STATUS = {ValueError: 422, UnknownError: 404, TooLargeError: 413, FullError: 429, OSError: 500}
"""Of errors that say what is wrong."""


def create(settings: Settings) -> FastAPI:
    """The server; when it ends, so do its jobs, and its files are removed."""

    @asynccontextmanager
    async def life(app: FastAPI) -> AsyncIterator[None]:
        app.state.place = Place(settings)
        try:
            yield
        finally:
            await anyio.to_thread.run_sync(app.state.place.close)

    presets.presets()  # here, since Hydra composes one configuration at a time
    app = FastAPI(docs_url=None, redoc_url=None, openapi_url=None, lifespan=life)
    app.add_middleware(Guard)
    for kind, status in STATUS.items():
        app.add_exception_handler(kind, _explained(status))
    app.include_router(routes.site)
    app.include_router(routes.tab)
    app.mount("/static", StaticFiles(directory=routes.STATIC), name="static")
    return app


def _explained(status: int) -> Any:
    def answer(_: Request, error: Exception) -> JSONResponse:
        return JSONResponse({"error": str(error)}, status)

    return answer
