"""`python -m fracgen.annotate`: a page to place two grips on a photo, choose a material, and see what happens.

It is served on this machine only, and no request leaves it. With a folder it pages through the images in it; saving
writes NAME.json beside the image, and nothing else.
"""

import argparse
import contextlib
import socket
import sys
import threading
import webbrowser
from collections.abc import Sequence
from typing import TYPE_CHECKING

from fracsim.entry import BAD, Interrupt, complain

if TYPE_CHECKING:  # an extra
    from fracgen.annotation.place import Settings

HOST = "127.0.0.1"
PORT = 8765


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    """The parsed options."""
    parser = argparse.ArgumentParser(prog="python -m fracgen.annotate", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)  # fmt: skip
    parser.add_argument("images", nargs="?", default="", metavar="IMAGE|FOLDER", help="what to begin with")
    parser.add_argument("--port", type=int, default=PORT, help=f"port on {HOST}; 0 takes a free one ({PORT})")
    parser.add_argument("--no-browser", action="store_true", help="open no browser, only print the address")
    parser.add_argument("--run", default="", metavar="FOLDER", help="checkpoint of the generator, as runs/stage3-ID")
    parser.add_argument("--set", dest="overrides", action="append", default=[], metavar="FIELD=VALUE",
                        help="passed on to fracgen.sample; repeatable, as --set vae.path=WEIGHTS")  # fmt: skip
    options = parser.parse_args(argv)
    if not 0 <= options.port <= 65535:
        parser.error(f"--port {options.port} must be 0 to 65535.")
    if options.overrides and not options.run:
        parser.error("--set is for the generator: give its checkpoint too, --run FOLDER.")
    return options


def listening(port: int) -> socket.socket:
    """A socket of this machine only; raises ValueError when the port is taken."""
    server = socket.socket()
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        server.bind((HOST, port))
    except OSError as error:
        server.close()
        raise ValueError(f"--port {port} cannot be used ({error.strerror}): give another, or --port 0.") from None
    server.listen()
    return server


def main(argv: Sequence[str] | None = None) -> int:
    """Serve the page until Ctrl-C or SIGTERM; exit status 2 after an error."""
    options = arguments(argv)
    try:
        import uvicorn

        from fracgen.annotation import app
    except ImportError as error:
        if (error.name or "").partition(".")[0] in ("fracgen", "fracsim"):
            raise
        complain(f"the annotation page needs {error.name}, which is not installed: pip install 'fracsim[ui]'")
        return BAD
    try:
        settings = _settings(options)
        server = listening(options.port)
    except (ValueError, OSError) as error:
        complain(str(error))
        return BAD
    address = f"http://{HOST}:{server.getsockname()[1]}/"
    print(f"{address}  (Ctrl-C ends)", flush=True)
    if not options.no_browser:
        threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()
    config = uvicorn.Config(app.create(settings), log_level="warning", access_log=False, timeout_graceful_shutdown=2)
    # The server ends its jobs, then raises the signal again.
    with contextlib.suppress(KeyboardInterrupt), Interrupt():
        uvicorn.Server(config).run(sockets=[server])
    return 0


def _settings(options: argparse.Namespace) -> "Settings":
    """What the page works with; raises ValueError for a path that cannot be used."""
    from fracgen.annotation import album, checkpoint, commands
    from fracgen.annotation.place import Settings

    images = album.opened(options.images)
    if not options.run:
        return Settings(images)
    return Settings(images, checkpoint.size(options.run),
                        generate=commands.Generate(options.run, tuple(options.overrides)))  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
