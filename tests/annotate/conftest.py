"""The tests of the annotation page need the extra `ui`."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("fastapi") else ["*"]
